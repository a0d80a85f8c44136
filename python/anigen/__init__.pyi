from os import PathLike
from typing import Any, Callable, Dict, List, Optional, Sequence, Tuple, Union

import numpy as np
from numpy.typing import ArrayLike, NDArray

File = Union[str, "PathLike[str]"]
Progress = Callable[[str, float], Optional[bool]]

class Error(RuntimeError):
    """A run that cannot go on although its input was fine."""

class InputError(ValueError):
    """Something that the caller gave is wrong; names file and place."""

class Interrupted(RuntimeError):
    """The call was cancelled by its progress function."""

class Asset:
    """A rigged asset in memory: mesh, skeleton, skin weights, clips. Right-handed, Z up."""

    name: str
    @property
    def vertices(self) -> NDArray[np.float32]:
        """[V, 3], a view of the asset's memory."""
    @property
    def faces(self) -> NDArray[np.int32]:
        """[F, 3], a view."""
    @property
    def joints(self) -> NDArray[np.float64]:
        """[J, 3] in the bind pose, a copy."""
    @property
    def parents(self) -> NDArray[np.int32]:
        """[J], -1 for the root, parents first, a view."""
    @property
    def joint_names(self) -> List[str]: ...
    @property
    def skin(self) -> NDArray[np.float32]:
        """[V, J], rows sum to 1, a copy."""
    @property
    def clips(self) -> List[Tuple[str, float]]:
        """Name and length in seconds of each clip."""

def load(file: File) -> Asset:
    """.glb .gltf .fbx .dae .obj .ply .stl .3mf"""

def load_bytes(data: bytes, name: str) -> Asset:
    """A file in memory; the extension of `name` says its format."""

def save(asset: Asset, file: File) -> None:
    """.glb .gltf .fbx .usda .usdz, by rename."""

def save_bytes(asset: Asset, format: str = "glb") -> bytes:
    """glb, gltf, fbx or usdz."""

def from_arrays(vertices: ArrayLike, faces: ArrayLike, joints: Optional[ArrayLike] = None,
                parents: Sequence[int] = (), skin: Optional[ArrayLike] = None, names: Sequence[str] = ()) -> Asset:
    """An asset of vertices [V, 3], faces [F, 3], joints [J, 3], parents [J] (-1 for the root, parents first) and
    weights [V, J]. Arrays are copied."""

def rig(asset: Asset, *, method: str = "auto", skin: str = "", templates: Sequence[str] = (),
        keep_skeleton: bool = True, learned_joints: bool = True, joints: int = 0, symmetric: bool = False,
        influences: int = 4, names: str = "", height: float = 0.0, ground: bool = False,
        progress: Optional[Progress] = None) -> Tuple[Asset, str]:
    """The rigged asset and, in one line, how joints and weights came about. Options are those of anigen-rig."""

def template_words() -> List[str]: ...

def animate(asset: Asset, motions: Sequence[str] = ("idle",), *, fps: float = 30.0, speed: float = 1.0,
            travel: bool = False, progress: Optional[Progress] = None) -> Asset:
    """A copy with further clips: words of motions_of(), or FILE or FILE#CLIP."""

def motion_words() -> List[str]: ...
def motions_of(asset: Asset) -> List[str]: ...

def evaluate(predicted: Asset, truth: Asset, *, metrics: Sequence[str] = (), protocol: str = "",
             normalization: str = "", registration: bool = True, surface_samples: int = 100_000,
             progress: Optional[Progress] = None) -> Dict[str, float]:
    """The numbers of anigen-eval by their keys (docs/metrics.md); one that cannot be computed is missing.

    metrics: skeleton, transport, skin, surface, image, motion, anymate, soundness; none: all but soundness."""

def gromov_wasserstein(joints_a: ArrayLike, parents_a: Sequence[int], joints_b: ArrayLike,
                       parents_b: Sequence[int]) -> float:
    """By distances along the bones, in the unit of the joints [J, 3]."""

def wasserstein(joints_a: ArrayLike, parents_a: Sequence[int], joints_b: ArrayLike,
                parents_b: Sequence[int]) -> float: ...

def chamfer(joints_a: ArrayLike, parents_a: Sequence[int], joints_b: ArrayLike,
            parents_b: Sequence[int]) -> Dict[str, float]:
    """{"j2j", "j2b", "b2b"}"""

def lint(asset: Asset) -> List[Dict[str, Any]]:
    """Findings with code, severity, sentence, count and share, the gravest first."""

def render(asset: Asset, *, width: int = 512, height: int = 512, mode: str = "color", skeleton: bool = False,
           transparent: bool = False, yaw: float = ..., pitch: float = ..., clip: int = -1,
           time: float = 0.0) -> NDArray[np.uint8]:
    """RGBA [height, width, 4]. mode: color, normals, weights; yaw and pitch of the camera in degrees."""

class Generator:
    """Image to rigged asset, with models that are loaded once."""

    def __init__(self, *, runs: Optional[File] = None, device: str = "cpu", precision: str = "fp32",
                 background: str = "auto") -> None:
        """runs: folder of both flows; None: the weights that are installed."""
    def generate(self, image: Union[File, bytes], *, seed: int = 42,
                 progress: Optional[Progress] = None) -> Tuple[Asset, List[str]]:
        """The asset, and what was done to image and mesh. image: a file, or an encoded image in memory."""

def to_torch(asset: Asset) -> Dict[str, Any]: ...
