"""What no rule makes is refused by name, with what is made in its place."""


rule unknown_target:
    input:
        unknown,
    output:
        "{target}",
    wildcard_constraints:
        target=made_by_none(),
