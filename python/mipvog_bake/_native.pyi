"""The extension module: the library behind the package. Only the package itself uses it."""

from collections.abc import Callable, Mapping, Sequence
from os import PathLike
from typing import Any, Optional, Union, final

import numpy as np
import numpy.typing as npt

__version__: str

_Path = Union[str, PathLike[str]]
_Floats = npt.NDArray[np.float32]
_Progress = Optional[Callable[[str, float], Any]]

def main(arguments: Sequence[str]) -> int: ...
def call(
    arguments: Sequence[str],
    arrays: Optional[Arrays] = None,
    progress: _Progress = None,
    fit: Optional[tuple[int, float]] = None,
    data: Optional[bytes] = None,
) -> str: ...
def option_names(verb: str) -> list[tuple[str, bool]]: ...
def png(width: int, height: int, values: bytes) -> bytes: ...
def frusta(
    text: Optional[str], path: Optional[str]
) -> tuple[list[list[float]], list[list[float]]]: ...
def doubled(
    min: Sequence[float], max: Sequence[float], nodes: Sequence[int]
) -> tuple[list[float], list[float], list[int]]: ...
def harmonics(directions: _Floats, functions: int) -> _Floats: ...

@final
class Arrays:
    def __new__(
        cls,
        tensors: Sequence[tuple[str, str, Sequence[int], Sequence[npt.NDArray[np.uint8]]]],
        texts: Mapping[str, str],
    ) -> Arrays: ...

@final
class NativeField:
    @staticmethod
    def open(arguments: Sequence[str]) -> NativeField: ...
    @staticmethod
    def of_bytes(options: Sequence[str], bytes: bytes) -> NativeField: ...
    @staticmethod
    def of_arrays(arrays: Arrays) -> NativeField: ...
    def description(self) -> str: ...
    def unpack(
        self, levels: Sequence[int]
    ) -> list[tuple[str, str, list[int], npt.NDArray[np.uint8]]]: ...
    def probe(
        self, origins: npt.NDArray[np.float64], directions: npt.NDArray[np.float64], level: int
    ) -> tuple[_Floats, _Floats, _Floats]: ...
    def sample(
        self, positions: npt.NDArray[np.float64], level: int
    ) -> tuple[_Floats, _Floats, _Floats, _Floats, _Floats]: ...
    def render(
        self,
        text: Optional[str],
        path: Optional[_Path],
        frame: Optional[str],
        size: tuple[int, int],
        progress: _Progress = None,
    ) -> _Floats: ...

@final
class NativeFit:
    def __new__(
        cls,
        arrays: Arrays,
        degree: int,
        cameras: Sequence[Sequence[float]],
        inner: Optional[Sequence[Sequence[float]]] = None,
    ) -> NativeFit: ...
    def directions(self, nodes: npt.NDArray[np.int64]) -> tuple[_Floats, npt.NDArray[np.int64]]: ...
    def judges(self, nodes: npt.NDArray[np.int64]) -> tuple[_Floats, npt.NDArray[np.int64]]: ...
    def coefficients(self, nodes: npt.NDArray[np.int64], colors: _Floats) -> _Floats: ...
