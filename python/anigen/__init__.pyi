from os import PathLike
from typing import Any, Callable, Dict, List, Optional, Sequence, Tuple, Union, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

File = Union[str, "PathLike[str]"]
Progress = Callable[[str, float], Optional[bool]]

class Error(RuntimeError):
    """A run that cannot go on although its input was fine."""

class InputError(ValueError):
    """Something that the caller gave is wrong; names file and place."""

class Interrupted(RuntimeError):
    """The call was cancelled by its progress function, which returned False. What that raises reaches the caller as it
    is."""

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
    weights [V, J], none below 0; rows without any follow the root. names: one per joint, or none. Arrays are copied;
    faces and parents are integers."""

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
             normalization: str = "centroid-rms", registration: bool = True, surface_samples: int = 100_000,
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

def lint(asset: Union[Asset, File]) -> List[Dict[str, Any]]:
    """Findings with code, severity, sentence, count and share, the gravest first. Of a file also what had to be
    repaired to read it, which an asset does not know."""

def render(asset: Asset, *, width: int = 512, height: int = 512, mode: str = "color", skeleton: bool = False,
           transparent: bool = False, yaw: float = ..., pitch: float = ..., clip: int = -1,
           time: float = 0.0) -> NDArray[np.uint8]:
    """RGBA [height, width, 4]. mode: color, normals, weights; yaw and pitch of the camera in degrees."""

@overload
def prepare(asset: Asset, *, cleaning: str = "none", resolution: int = 64,
            progress: Optional[Progress] = None) -> Dict[str, Any]:
    """A training example of one rigged asset, as a dataset holds it:

    asset: in [-0.5, 0.5]^3, longest side 1, Z up, cleaned (none, anymate, articulation-xl); scale, float, and offset,
    float64 [3]: asset = scale * original + offset; voxels, int32 [N, 3], that the surface touches, and skeleton_voxels,
    int32 [M, 3], that bones cross, x, y, z in [0, resolution), ascending; findings: what cleaning changed; usable: the
    splits of a dataset would take it."""

@overload
def prepare(inputs: Union[File, Sequence[File]], output: File, *, creatures: int = 0, poses: int = 0,
            cleaning: str = "none", keep_assets: bool = True, resolution: int = 64, views: int = 0,
            view_size: int = 512, condition_views: int = 0, condition_view_size: int = 1024,
            front_cameras: bool = False, view_geometry: bool = False, features: str = "",
            feature_weights: Optional[File] = None, test_fraction: Optional[float] = None, seed: int = 0,
            progress: Optional[Progress] = None) -> Dict[str, Any]:
    """The dataset that anigen-prepare makes of files and folders of rigs and of procedural creatures, byte for byte, on
    the threads of this process. The same call goes on where an earlier one was cancelled. features: surface, or a
    network of feature_weights; they need LibTorch.

    Returns counts: assets, variants (their posed copies), reused (made by an earlier call), train, test, unusable,
    failed_steps (failures.jsonl says which), bytes; and rejected: a list of {source, reason, step}."""

class Generated:
    """What a generator made of an image."""

    @property
    def asset(self) -> Optional[Asset]:
        """In the unit cube, Z up, facing -y; None after stop_at="voxels"."""
    @property
    def notices(self) -> List[str]:
        """What was done to image and mesh, a sentence each."""
    @property
    def seconds(self) -> Dict[str, float]:
        """condition, structure, latents, decode"""
    @property
    def voxels(self) -> bytes:
        """Those of the first flow, NPZ: shape and skeleton, uint8 [N, 3]; resolution, int64 [1]."""

class Generator:
    """Image to rigged asset, with models that are loaded once."""

    def __init__(self, *, runs: Optional[File] = None, structure_flow: Optional[File] = None,
                 latent_flow: Optional[File] = None, counts_joints: bool = False, device: str = "cpu",
                 precision: str = "fp32", background: str = "auto") -> None:
        """runs: folder of both flows; None: the weights that are installed. structure_flow, latent_flow: run folders
        that are named. counts_joints: of several second flows in `runs` the one that was told numbers of joints, for
        generate(joints=N)."""
    def generate(self, image: Union[File, bytes], *, seed: int = 42, joints: int = 0, ss_steps: Optional[int] = None,
                 slat_steps: Optional[int] = None, mask: Union[File, bytes, None] = None, stop_at: str = "",
                 voxels: Union[File, bytes, None] = None, pictures: Optional[Callable[[str, bytes], Any]] = None,
                 progress: Optional[Progress] = None) -> Generated:
        """image, mask: a file, or an encoded image in memory. The mask has the image's size; the object is where it is
        above half. stop_at="voxels" ends after the first flow; voxels: Generated.voxels of an earlier call, which then
        does not run again. pictures(name, png) gets "mask", "normals" (where the flow sees them), "voxels" and "votes"
        as they come."""

def to_torch(asset: Asset) -> Dict[str, Any]:
    """Tensors: vertices float32 [V, 3], faces int32 [F, 3], joints float64 [J, 3], parents int32 [J], skin float32
    [V, J]. Vertices, faces and parents share the asset's memory. Error without PyTorch for Python."""
