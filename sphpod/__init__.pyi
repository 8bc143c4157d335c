from sphpod.api import compare as compare
from sphpod.api import decompose as decompose
from sphpod.api import decompose_lifted as decompose_lifted
from sphpod.api import plot_errors as plot_errors
from sphpod.api import plot_modes as plot_modes
from sphpod.api import plot_profile as plot_profile
from sphpod.api import relative_error as relative_error
from sphpod.api import solve_lifted as solve_lifted
from sphpod.api import solve_reduced as solve_reduced
from sphpod.api import solve_reference as solve_reference
from sphpod.api import solve_sph as solve_sph
from sphpod.api import sweep as sweep
from sphpod.api import take_snapshots as take_snapshots
from sphpod.config.config import ConfigError as ConfigError
from sphpod.config.configured import load_samplings as load_samplings
from sphpod.config.configured import load_scene as load_scene
from sphpod.config.configured import make_scene as make_scene
from sphpod.scene.breakdown import Breakdown as Breakdown
from sphpod.scene.scene import Scene as Scene
from sphpod.surveys.loaded import load_survey as load_survey

__version__: str
__all__: list[str]
