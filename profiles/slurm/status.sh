#!/bin/sh
# State of a SLURM job, as Snakemake asks for it: running, success or failed.
job=$(scontrol --oneliner show job "$1" 2>&1)
state=${job#*JobState=}
state=${state%% *}
case $job in
    *JobState=*) ;;
    *"Invalid job id"*)
        # The controller keeps ended jobs for some minutes; accounting keeps them, where there is any.
        state=$(sacct --noheader --allocations --format=State --jobs="$1" 2>/dev/null | tr -d ' ')
        state=${state:-UNKNOWN}
        ;;
    *) state=RUNNING ;; # No answer: it is asked again.
esac
case $state in
    COMPLETED) echo success ;;
    PENDING | CONFIGURING | RUNNING | COMPLETING | SUSPENDED | REQUEUED | RESIZING | STOPPED) echo running ;;
    *) echo failed ;;
esac
