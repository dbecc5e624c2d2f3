"""Streaming LiDAR mapping: poses and a map from scans.

Poses are 4x4 matrices T_world_lidar: p_world = T @ p_lidar. Lengths are metres, stamps are whole
nanoseconds. The same scans and options give the same bits at any number of threads.

    mapping = lamina.Mapping(config="kitti_raw")
    for points, stamp_ns, times in scans:
        mapped = mapping.add(points, stamp_ns, times)
        print(mapped.status, mapped.pose[:3, 3])
    mapping.finish()
    poses = mapping.trajectory().poses
"""

import os
from typing import Any, Mapping as _Mapping, Optional, TypedDict, Union

import numpy as np
import numpy.typing as npt

__version__: str

class InputError(ValueError):
    """Data that cannot be used: a missing file, an array of another shape."""

class OptionError(ValueError):
    """An option that there is not, or a value outside of its rule."""

class MappedScan:
    """What became of a scan."""

    @property
    def index(self) -> int:
        """Number of the scan, from 0 on."""
    @property
    def stamp_ns(self) -> int:
        """As it was given, or made up."""
    @property
    def recording(self) -> str:
        """The name of its recording that add() was given."""
    @property
    def status(self) -> str:
        """first, tracked, degenerate, lost, or the reason why the scan was skipped."""
    @property
    def skipped(self) -> bool:
        """Whether it could not be used at all: it has no pose of its own."""
    @property
    def detail(self) -> str:
        """Of a skip."""
    @property
    def pose(self) -> npt.NDArray[np.float64]:
        """(4, 4), as known when the scan was added, in the frame of odometry, which never jumps;
        bundle adjustment may move it later."""
    @property
    def pose_in_map(self) -> npt.NDArray[np.float64]:
        """(4, 4), the same in the map as loops have corrected it by then. It may jump."""
    @property
    def covariance(self) -> npt.NDArray[np.float64]:
        """(6, 6) of the pose relative to the map: rotation (rad), then translation (m)."""
    @property
    def inlier_share(self) -> float:
        """Share of its clusters that agree with the map, 0 to 1."""
    @property
    def residual_m(self) -> float:
        """Root mean square distance of these from the planes of the map."""
    @property
    def unobservable_directions(self) -> int:
        """Degenerate directions of the pose, of 6; 1 as well where it is only uncertain or ambiguous."""
    @property
    def keyframe(self) -> bool:
        """Whether it takes part in bundle adjustment and becomes part of the map."""
    @property
    def piece(self) -> int:
        """The piece of the map in whose frame the pose is."""
    @property
    def points(self) -> int:
        """Points that were used: finite, and within range."""
    @property
    def clusters(self) -> int:
        """Clusters that these became."""

class Trajectory:
    """Poses of scans, in order."""

    def __len__(self) -> int: ...
    @property
    def stamps_ns(self) -> npt.NDArray[np.int64]:
        """(N,) stamps, ns."""
    @property
    def poses(self) -> npt.NDArray[np.float64]:
        """(N, 4, 4)."""
    @property
    def skipped(self) -> npt.NDArray[np.bool_]:
        """Scans whose pose is not of their own points."""
    @property
    def pieces(self) -> npt.NDArray[np.int64]:
        """(N,) the piece of the map in whose frame each pose is."""

class Scan:
    """A scan of a recording."""

    @property
    def stamp_ns(self) -> int:
        """When it was taken, ns; made up where the recording does not tell."""
    @property
    def points(self) -> npt.NDArray[np.float32]:
        """(N, 4): x, y, z, intensity."""
    @property
    def times(self) -> Optional[npt.NDArray[np.float32]]:
        """(N,) seconds from the stamp; None if the file has none."""

class Recording:
    """A recording on disk: whatever `lamina run --scans` takes, of `options` those under "scans.".

    len(recording), recording[i] and iteration give its scans, read anew each time.
    """

    def __init__(
        self, path: Union[str, os.PathLike[str]], config: str = "", options: _Mapping[str, Any] = ...
    ) -> None: ...
    def __len__(self) -> int: ...
    def __getitem__(self, i: int) -> Scan: ...
    def name(self, i: int) -> str:
        """Of the file of scan i."""

class Surfels(TypedDict):
    """Planes of the map, M of them."""

    centre: npt.NDArray[np.float64]  # (M, 3)
    normal: npt.NDArray[np.float32]  # (M, 3), unit
    eigenvalues: npt.NDArray[np.float32]  # (M, 3), m^2, descending
    count: npt.NDArray[np.uint32]  # (M,) points
    piece: npt.NDArray[np.int64]  # (M,)

class Mapping:
    """Scans in, poses and a map out. One thread at a time."""

    def __init__(self, config: str = "", options: _Mapping[str, Any] = ...) -> None:
        """`config`: a file, or the name of a shipped one ("kitti_raw"); `options`: by dotted name,
        {"map.root_size_m": 1.2}. Beyond map.budget_mb what was not seen for longest is lost."""
    def add(
        self,
        points: npt.ArrayLike,
        stamp_ns: Optional[int] = None,
        times: Optional[npt.ArrayLike] = None,
        recording: str = "",
    ) -> MappedScan:
        """The next scan: points (N, 3) or (N, 4) in the frame of the sensor, times (N,) in seconds
        from the stamp. Without a stamp, scans are taken to be 0.1 s apart."""
    def add_recording(
        self, recording: Recording, first: int = 0, last: Optional[int] = None
    ) -> None:
        """Scans [first, last) of a recording, read ahead on all cores."""
    def finish(self) -> None:
        """No more scans come: one last bundle adjustment."""
    def trajectory(self, frame: str = "map") -> Trajectory:
        """Poses of all scans, as known now: in the "map", as loops have corrected it, or in "odom",
        the frame of MappedScan.pose."""
    def surfels(self, min_frames: Optional[int] = None) -> Surfels:
        """Planes that so many scans have seen; as configured (2) if None."""
    @property
    def counts(self) -> dict[str, int]:
        """Scans, frames, keyframes, and how many were lost or degenerate, so far."""

def read_trajectory(path: Union[str, os.PathLike[str]]) -> Trajectory:
    """A file in KITTI or TUM form."""

def evaluate(
    estimate: npt.ArrayLike, truth: npt.ArrayLike, alignment: str = "se3"
) -> dict[str, Any]:
    """Errors of poses (N, 4, 4) against true ones, pose by pose. alignment: se3, first or none."""
