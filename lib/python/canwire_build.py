# SPDX-License-Identifier: MIT
"""Builds the Python package: the backend of pip (PEP 517), which needs Python alone.

The library is made with make and a C compiler: of the checkout, or of the sources that a source
package has in `sources`. Without these the package needs a library that is installed.
`scripts/wheel` makes the wheel for others, which brings all libraries that it needs.
"""
import base64
import gzip
import hashlib
import importlib.util
import io
import os
import pathlib
import re
import shlex
import shutil
import subprocess
import sys
import sysconfig
import tarfile
import zipfile

PACKAGE = pathlib.Path(__file__).resolve().parent
IS_SDIST = (PACKAGE / "sources/Makefile").exists()
ROOT = PACKAGE / "sources" if IS_SDIST else PACKAGE.parent.parent
README = PACKAGE / "README.md" if IS_SDIST else ROOT / "daemon/man/canwire-python.7.md"
LICENCE = PACKAGE / "LICENSE" if IS_SDIST else ROOT / "LICENSE"
BUILT = "build/release/libcanwire-sim.so"
DATE = (1980, 1, 1, 0, 0, 0)  # the same sources make the same files
HEADERS = {"yaml.h": "libyaml-dev", "jansson.h": "libjansson-dev"}
# The library is made of these: the folders SIM_FOLDERS of the Makefile, and headers of others.
SOURCES = ("Makefile", "lib/**/*.[ch]", "daemon/**/*.h",
           *(f"daemon/{folder}/**/*.c" for folder in ("base", "timing", "trace", "config", "run",
                                                   "record", "sim", "embed")))


def version():
    return re.search(r"^VERSION := (.*)", (ROOT / "Makefile").read_text(), re.M)[1]


# ---- What pyproject.toml says --------------------------------------------------------------------


def metadata(licences=("LICENSE",)):
    """Returns METADATA."""
    text = (PACKAGE / "pyproject.toml").read_text()
    value = {key: re.search(rf'^{key} = "(.*)"', text, re.M)[1]
             for key in ("name", "description", "requires-python")}
    extras = re.findall(r"^(\w+) = \[(.*)\]", text.split("optional-dependencies]")[1]
                        .split("\n\n")[0], re.M)
    lines = ["Metadata-Version: 2.1", f"Name: {value['name']}", f"Version: {version()}",
             f"Summary: {value['description']}", "License: MIT",
             *(f"License-File: {name}" for name in licences),
             f"Requires-Python: {value['requires-python']}"]
    for extra, needed in extras:
        lines += [f"Provides-Extra: {extra}", *(f'Requires-Dist: {one} ; extra == "{extra}"'
                                                for one in re.findall('"([^"]+)"', needed))]
    lines += ["Description-Content-Type: text/markdown", "", README.read_text(encoding="utf-8")]
    return "\n".join(lines)


def entry_points():
    """Returns entry_points.txt."""
    text = (PACKAGE / "pyproject.toml").read_text() + "\n\n"
    parts = []
    for name, group, lines in re.findall(
            r'\[project\.(scripts|entry-points\.["\']?([\w.]+)["\']?)\]\n(.*?)\n\n', text, re.S):
        parts += [f"[{group if name != 'scripts' else 'console_scripts'}]",
                  *(line.replace('"', "") for line in lines.splitlines()), ""]
    return "\n".join(parts)


def python_files():
    return sorted(path for path in (PACKAGE / "src/canwire").iterdir()
                  if path.is_file() and path.suffix != ".so")


def info_files(tag, licences=None):
    """Returns {name: content} of the folder dist-info. licences: the texts of other projects."""
    texts = {"LICENSE": LICENCE.read_text(encoding="utf-8"), **(licences or {})}
    files = {"METADATA": metadata(texts), "entry_points.txt": entry_points(),
             "WHEEL": f"Wheel-Version: 1.0\nGenerator: canwire {version()}\n"
                      f"Root-Is-Purelib: {str(tag == 'any').lower()}\nTag: py3-none-{tag}\n",
             **{f"licenses/{name}": text for name, text in texts.items()}}
    return {f"canwire-{version()}.dist-info/{name}": text.encode()
            for name, text in files.items()}


# ---- The library ---------------------------------------------------------------------------------


def missing_tools():
    """Returns {what is not there: the Debian package that has it}."""
    compiler = shlex.split(os.environ.get("CC", "cc"))
    missing = {program: package for program, package in
               (("make", "make"), (compiler[0], "gcc")) if not shutil.which(program)}
    if compiler[0] not in missing:
        for header, package in HEADERS.items():
            done = subprocess.run([*compiler, "-E", "-x", "c", "-o", os.devnull, "-"], check=False,
                                  input=f"#include <stdlib.h>\n#include <{header}>\n", text=True,
                                  stderr=subprocess.DEVNULL)
            if done.returncode:
                missing[header] = package
    return missing


def installed_library():
    """Returns the path of a library that this package can use, or None."""
    spec = importlib.util.spec_from_file_location("_library",
                                                  PACKAGE / "src/canwire/_library.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    try:
        return module.library().path
    except ImportError:
        return None


def find_library():
    """Returns the path of the library, which it builds, or None for one that is installed."""
    wanted = os.environ.get("CANWIRE_SIM_LIBRARY")
    missing = {} if wanted else missing_tools()
    if not wanted and not missing:
        make = ["make", "-s", f"-j{os.cpu_count() or 1}", "BUILD=build/release", BUILT]
        if subprocess.run(make, cwd=ROOT, check=False, stdout=sys.stderr).returncode:
            sys.exit(f"canwire: make has failed in {ROOT}; its messages are above")
        return ROOT / BUILT
    if found := installed_library():
        print(f"canwire: the package uses {found}", file=sys.stderr)
        return None
    if wanted:
        sys.exit(f"canwire: CANWIRE_SIM_LIBRARY={wanted} cannot be loaded")
    sys.exit(f"canwire: libcanwire-sim.so cannot be built without {', '.join(missing)}, and none "
             "is installed.\n"
             f"Debian, Ubuntu: sudo apt install {' '.join(missing.values())}\n"
             "Or install canwire first (`make install`, or its Debian package), or a wheel.")


# ---- Files ---------------------------------------------------------------------------------------


def write_wheel(folder, tag, files):
    """Writes a wheel of {name: content}; returns its name."""
    record = []
    for name, content in files.items():
        digest = base64.urlsafe_b64encode(hashlib.sha256(content).digest()).rstrip(b"=").decode()
        record.append(f"{name},sha256={digest},{len(content)}")
    name = f"canwire-{version()}.dist-info/RECORD"
    files = {**files, name: "\n".join([*record, f"{name},,", ""]).encode()}
    path = pathlib.Path(folder) / f"canwire-{version()}-py3-none-{tag}.whl"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as out:
        for name, content in files.items():
            entry = zipfile.ZipInfo(name, DATE)
            entry.compress_type = zipfile.ZIP_DEFLATED
            entry.external_attr = (0o755 if ".so" in name else 0o644) << 16
            out.writestr(entry, content)
    return path.name


def package_files():
    return {f"canwire/{path.name}": path.read_bytes() for path in python_files()}


def platform_tag(library):
    return "any" if library is None else re.sub(r"\W", "_", sysconfig.get_platform())


def source_files():
    """Returns {name: path} of a source package, without PKG-INFO."""
    files = {path.relative_to(PACKAGE): path for path in
             [*python_files(), PACKAGE / "pyproject.toml", PACKAGE / "canwire_build.py"]}
    files.update({"LICENSE": LICENCE, "README.md": README})
    for pattern in SOURCES:
        for path in sorted(ROOT.glob(pattern)):
            files[f"sources/{path.relative_to(ROOT)}"] = path
    return files


# ---- The hooks -----------------------------------------------------------------------------------


def build_wheel(wheel_directory, config_settings=None, metadata_directory=None):
    del config_settings, metadata_directory
    library = find_library()
    tag = platform_tag(library)
    files = package_files()
    if library is not None:
        files[f"canwire/{library.name}"] = library.read_bytes()
    return write_wheel(wheel_directory, tag, {**files, **info_files(tag)})


def build_editable(wheel_directory, config_settings=None, metadata_directory=None):
    """The package is that of the checkout, and gets the library beside it."""
    del config_settings, metadata_directory
    library = find_library()
    if library is not None:
        shutil.copy(library, PACKAGE / "src/canwire")
    files = {"canwire.pth": f"{PACKAGE / 'src'}\n".encode()}
    return write_wheel(wheel_directory, "any", {**files, **info_files("any")})


def prepare_metadata_for_build_wheel(metadata_directory, config_settings=None):
    del config_settings
    for name, content in info_files("any").items():
        path = pathlib.Path(metadata_directory) / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content)
    return f"canwire-{version()}.dist-info"


prepare_metadata_for_build_editable = prepare_metadata_for_build_wheel


def build_sdist(sdist_directory, config_settings=None):
    del config_settings
    files = {str(name): path.read_bytes() for name, path in source_files().items()}
    files["PKG-INFO"] = metadata().encode()
    path = pathlib.Path(sdist_directory) / f"canwire-{version()}.tar.gz"
    with path.open("wb") as file, gzip.GzipFile("", "wb", fileobj=file, mtime=0) as packed, \
            tarfile.open(fileobj=packed, mode="w") as out:
        for name, content in files.items():
            entry = tarfile.TarInfo(f"canwire-{version()}/{name}")
            entry.size = len(content)
            out.addfile(entry, io.BytesIO(content))
    return path.name
