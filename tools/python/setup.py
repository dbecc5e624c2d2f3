"""pip install ./tools/python: builds the module by CMake, from the packages that tools/packages names.

LAMINA_BUILD_DIR names a CMake build folder to go on from; a new one is made without it.
"""
import os
import shutil
import subprocess
import sys
from pathlib import Path

from setuptools import Extension, setup
from setuptools.command.build_ext import build_ext

ROOT = Path(os.environ.get("LAMINA_SOURCE_DIR", Path(__file__).resolve().parents[2]))


class CMakeBuild(build_ext):
    def build_extension(self, ext):
        build = Path(os.environ.get("LAMINA_BUILD_DIR", Path(self.build_temp) / "cmake")).resolve()
        subprocess.check_call([
            "cmake", "-S", str(ROOT), "-B", str(build), "-G", "Ninja", "-DCMAKE_BUILD_TYPE=Release",
            "-DLAMINA_BUILD_TESTS=OFF", "-DLAMINA_BUILD_LAB=OFF", "-DLAMINA_BUILD_PYTHON=ON",
            f"-DPython_EXECUTABLE={sys.executable}"])
        subprocess.check_call(["cmake", "--build", str(build), "--target", "lamina_python"])
        target = Path(self.get_ext_fullpath(ext.name))
        target.parent.mkdir(parents=True, exist_ok=True)
        package = build / "python" / "lamina"
        shutil.copy(next(package.glob("__init__.*.so")), target)
        for types in ("__init__.pyi", "py.typed"):
            shutil.copy(package / types, target.parent / types)


setup(
    name="lamina",
    version="0.1.0",
    description="Streaming LiDAR mapping: poses and a map from scans",
    ext_modules=[Extension("lamina.__init__", [])],
    cmdclass={"build_ext": CMakeBuild},
    install_requires=["numpy"],
    python_requires=">=3.9",
)
