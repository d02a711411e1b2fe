"""Photos to triangle scenes for game engines, numpy in and out."""

from os import PathLike
from typing import Any, Callable, Literal, Mapping, Optional, Sequence, Union, overload

import numpy as np
from numpy.typing import NDArray

_Path = Union[str, "PathLike[str]"]
#: Arrays of a scene by name: see `read`.
_Scene = Mapping[str, Any]
_Source = Union[_Path, _Scene]
_Split = Literal["test", "train", "all"]
_Mode = Literal["soft", "solid"]

__version__: str

def read(path: _Path) -> dict[str, NDArray[Any]]:
    """A scene of any format as arrays.

    A soup: triangles (N, 3, 3), opacity (N,), sigma (N,), sh (N, K, 3). A mesh: positions (V, 3), faces (F, 3), colors (F, 3) or (V, 3).
    """

@overload
def train(
    dataset: _Path,
    output: None = None,
    *,
    force: bool = False,
    teacher: Optional[str] = None,
    budget: Optional[float] = None,
    dataset_options: Optional[Mapping[str, Any]] = None,
    callback: Optional[Callable[[dict[str, Any]], Any]] = None,
    **options: Any,
) -> dict[str, NDArray[Any]]: ...
@overload
def train(
    dataset: _Path,
    output: _Path,
    *,
    force: bool = False,
    teacher: Optional[str] = None,
    budget: Optional[float] = None,
    dataset_options: Optional[Mapping[str, Any]] = None,
    callback: Optional[Callable[[dict[str, Any]], Any]] = None,
    **options: Any,
) -> dict[str, Any]:
    """Trains a scene on a folder of photos with poses. Returns the report with `output`, the arrays of the soup without.

    `callback` gets part, step, triangles, loss and psnr after every step; where it returns False, the scene so far is the result.
    """

@overload
def bake(
    source: Union[_Source, Sequence[_Source]],
    output: None = None,
    *,
    dataset: Optional[_Path] = None,
    force: bool = False,
    harden: bool = False,
    max_bytes: Optional[int] = None,
    **options: Any,
) -> dict[str, NDArray[Any]]: ...
@overload
def bake(
    source: Union[_Source, Sequence[_Source]],
    output: _Path,
    *,
    dataset: Optional[_Path] = None,
    force: bool = False,
    harden: bool = False,
    max_bytes: Optional[int] = None,
    **options: Any,
) -> dict[str, Any]:
    """Bakes a scene for a game engine. Returns the report with `output`, the arrays of the mesh without."""

def make(
    inputs: Union[_Path, Sequence[_Path]],
    output: _Path,
    *,
    page: Optional[_Path] = None,
    work: Optional[_Path] = None,
    force: bool = False,
    anyway: bool = False,
    budget: float = 600.0,
    steps: Optional[int] = None,
    dataset_options: Optional[Mapping[str, Any]] = None,
    **options: Any,
) -> dict[str, Any]:
    """Makes files for an engine from photos, a video or photos with poses: poses, training, bake. Returns the report."""

def capture(
    inputs: Union[_Path, Sequence[_Path]],
    output: _Path,
    *,
    force: bool = False,
    **options: Any,
) -> dict[str, Any]:
    """Finds the camera poses of photos or a video and writes a data set. Returns the report."""

@overload
def mesh(
    source: _Source,
    output: None = None,
    *,
    dataset: Optional[_Path] = None,
    force: bool = False,
    dataset_options: Optional[Mapping[str, Any]] = None,
    **options: Any,
) -> dict[str, NDArray[Any]]: ...
@overload
def mesh(
    source: _Source,
    output: _Path,
    *,
    dataset: Optional[_Path] = None,
    force: bool = False,
    dataset_options: Optional[Mapping[str, Any]] = None,
    **options: Any,
) -> dict[str, Any]:
    """Makes one connected surface of a scene or of photos. Returns the report with `output`, the arrays of the mesh without."""

def eval(
    file: _Path,
    dataset: _Path,
    *,
    split: _Split = "test",
    mode: Optional[_Mode] = None,
    ssaa: Literal[1, 2, 4] = 4,
    dataset_options: Optional[Mapping[str, Any]] = None,
) -> dict[str, Any]:
    """Scores a scene on photos: PSNR, SSIM and FLIP of every photo and means."""

def render(
    file: _Path,
    *,
    orbit: Optional[int] = None,
    dataset: Optional[_Path] = None,
    split: _Split = "test",
    width: int = 960,
    show: Literal["color", "depth", "normal", "wires"] = "color",
    mode: Optional[_Mode] = None,
    ssaa: Literal[1, 2, 4] = 4,
    dataset_options: Optional[Mapping[str, Any]] = None,
) -> dict[str, NDArray[np.uint8]]:
    """Pictures of a scene, (H, W, 3), by their names."""

def to_trimesh(source: _Source) -> Any:
    """A mesh as a `trimesh.Trimesh`."""

def to_open3d(source: _Source) -> Any:
    """A mesh as an `open3d.geometry.TriangleMesh`."""
