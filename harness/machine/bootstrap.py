"""`make setup`: brings a fresh clone to a working .venv, with nothing but a Python 3 and its standard library.

Run as `python3 -I harness/machine/bootstrap.py`. Written so that even Python 3.6 reads it and says what it lacks. A
second run compares a stamp and ends; an interrupted one is continued by the next; two at once take turns. Exit status
3 when the machine lacks something that cannot be installed without a question, with the line that installs it.
"""

import contextlib
import ctypes
import hashlib
import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
from typing import Any, Dict, Iterator, List, Optional, Tuple

ROOT = os.path.dirname(os.path.dirname(os.path.dirname(os.path.realpath(__file__))))
VENV = os.path.join(ROOT, ".venv")
PYTHON = os.path.join(VENV, "bin", "python")
LOCK = os.path.join(ROOT, "requirements.lock")
STAMP = os.path.join(VENV, "setup-stamp.json")
# What the environment is made from: when one changes, set-up runs again.
INGREDIENTS = ("requirements.lock", "pyproject.toml", "harness/machine/bootstrap.py")
# As requires-python in pyproject.toml; a test compares them.
OLDEST, NEWEST = (3, 11), (3, 13)
EXIT_MACHINE = 3
# pip reads these from its own configuration, uv does not: then pip does the work.
PIP_ONLY_SETTINGS = r"(index-url|extra-index-url|no-index|proxy|trusted-host|client-cert)="
# As the checks of harness/machine/doctor.py say.
NATIVE_LIBRARIES = (("libatomic.so.1", ("libatomic1",)), ("libEGL.so.1", ("libegl1", "libgl1-mesa-dri")))


class SetupError(Exception):
    """The set-up cannot go on; the message says what to type."""


def main() -> int:
    try:
        with one_at_a_time():
            if not is_ready():
                set_up()
    except SetupError as error:
        say(str(error))
        return EXIT_MACHINE
    except KeyboardInterrupt:
        say("interrupted; `make setup` continues from here")
        return 130
    return 0


def set_up() -> None:
    if not is_usable():
        make_environment(find_python())
    install_packages()
    meet_native_needs()
    with open(STAMP + ".partial", "w") as file:
        json.dump(recipe(), file)
    os.replace(STAMP + ".partial", STAMP)
    say("ready: .venv/bin/harness")


def is_ready() -> bool:
    """True when an earlier run finished, from the same ingredients, in this folder, for a Python that still runs."""
    try:
        with open(STAMP) as file:
            return json.load(file) == recipe() and python_version(PYTHON) is not None
    except (OSError, ValueError):
        return False


def recipe() -> Dict[str, Any]:
    """What a finished environment depends on."""
    hashes = {}
    for name in INGREDIENTS:
        with open(os.path.join(ROOT, name), "rb") as file:
            hashes[name] = hashlib.sha256(file.read()).hexdigest()
    return {"venv": VENV, "python": os.path.realpath(PYTHON), "ingredients": hashes}


def find_python() -> str:
    """A supported interpreter: the one that runs this, else one of the PATH."""
    if OLDEST <= sys.version_info[:2] <= NEWEST:
        return sys.executable
    for minor in range(NEWEST[1], OLDEST[1] - 1, -1):
        found = shutil.which("python3.%d" % minor)
        if found and python_version(found):
            return found
    raise SetupError(
        "Python %d.%d is %s, and no python3.11, 3.12 or 3.13 is on the PATH; install one, for instance\n"
        "    apt-get install %s" % (sys.version_info[0], sys.version_info[1],
                                    "too old" if sys.version_info[:2] < OLDEST else "too new", python_packages()))


def python_packages() -> str:
    """The packages of the newest supported Python that this system has: 3.11 on Debian 12, 3.13 on Debian 13."""
    if shutil.which("apt-cache"):
        for minor in range(NEWEST[1], OLDEST[1] - 1, -1):
            name = "python3.%d" % minor
            if subprocess.call(["apt-cache", "show", name], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) == 0:
                return "%s %s-venv" % (name, name)
    return "python3 python3-venv"


def python_version(interpreter: str) -> Optional[Tuple[int, ...]]:
    """(major, minor) of an interpreter, None when it does not run."""
    try:
        text = subprocess.check_output([interpreter, "-I", "-c", "import sys; print(*sys.version_info[:2])"],
                                       stderr=subprocess.DEVNULL)
        return tuple(int(number) for number in text.split())
    except (OSError, ValueError, subprocess.CalledProcessError):
        return None


def is_usable() -> bool:
    """True when .venv holds a supported Python with pip, and was made in this very folder (scripts hold its path)."""
    version = python_version(PYTHON)
    if version is None or not OLDEST <= version <= NEWEST:
        return False
    try:
        with open(os.path.join(VENV, "bin", "pip"), errors="replace") as file:
            made_here = PYTHON in file.read()
    except OSError:
        return False
    return made_here and subprocess.call([PYTHON, "-I", "-m", "pip", "--version"], stdout=subprocess.DEVNULL,
                                         stderr=subprocess.DEVNULL) == 0


def make_environment(interpreter: str) -> None:
    version = python_version(interpreter)
    if version is None:
        raise SetupError("%s does not run" % interpreter)
    has_venv = [interpreter, "-I", "-c", "import venv, ensurepip"]
    if subprocess.call(has_venv, stderr=subprocess.DEVNULL) != 0:
        apt_install(["python%d.%d-venv" % version, *absent_libraries()], "Python's venv module is missing")
    say("making .venv with Python %d.%d" % version)
    shutil.rmtree(VENV, ignore_errors=True)
    made = subprocess.run([interpreter, "-I", "-m", "venv", VENV], stdout=subprocess.PIPE, stderr=subprocess.STDOUT)
    if made.returncode != 0:
        reason = made.stdout.decode(errors="replace").strip().splitlines()[-1:]
        raise SetupError("the environment .venv could not be made: " + "".join(reason))


def absent_libraries() -> List[str]:
    """Debian packages of libraries that are certainly absent: `doctor` would ask for them later, one line is kinder."""
    absent = []  # type: List[str]
    for library, packages in NATIVE_LIBRARIES:
        try:
            ctypes.CDLL(library)
        except OSError:
            absent.extend(packages)
    return absent


def install_packages() -> None:
    say("installing the packages of requirements.lock (about 1.2 GB on disk)")
    needed = ["--require-hashes", "-r", LOCK]
    # pip repeats what uv could not do, so uv's own complaints would only confuse.
    with_uv = install_uv() and subprocess.call(uv() + needed, env=uv_environment(), stderr=subprocess.DEVNULL) == 0
    if not with_uv:
        say("pip installs them, which takes a minute or two")
        run(pip() + needed,
            "packages could not be installed, as pip says above; check the network and repeat `make setup`")
    # The lock holds the build backend, so nothing is fetched here.
    run([*pip(), "--no-deps", "--no-build-isolation", "--no-index", "--editable", ROOT],
        "this project could not be installed into .venv")


def pip() -> List[str]:
    return [PYTHON, "-I", "-m", "pip", "install", "--quiet", "--disable-pip-version-check"]


def uv() -> List[str]:
    # Where Python may not write bytecode (containers often say so), each command would compile a thousand modules anew:
    # a warm report took 26 s of CPU time in place of 11. Elsewhere the first run of a command writes what it needs.
    compiled = ["--compile-bytecode"] if os.environ.get("PYTHONDONTWRITEBYTECODE") else []
    return [os.path.join(VENV, "bin", "uv"), "pip", "install", "--quiet", *compiled, "--python", PYTHON]


def uv_environment() -> Dict[str, str]:
    """The environment for uv, with the certificates that pip is told of in its own words."""
    environment = dict(os.environ)
    if "PIP_CERT" in environment:
        environment.setdefault("SSL_CERT_FILE", environment["PIP_CERT"])
    return environment


def install_uv() -> bool:
    """Install uv at its locked hash; False when pip has to do all the work, more slowly."""
    settings = subprocess.check_output([PYTHON, "-I", "-m", "pip", "config", "list"]).decode(errors="replace")
    if re.search(PIP_ONLY_SETTINGS, settings):
        return False
    with tempfile.NamedTemporaryFile("w", suffix=".txt") as locked:
        locked.write(locked_lines("uv"))
        locked.flush()
        return subprocess.call([*pip(), "--no-deps", "--require-hashes", "-r", locked.name]) == 0


def locked_lines(package: str) -> str:
    """A package's version and hashes, as the lock file has them."""
    with open(LOCK) as file:
        [lines] = re.findall(r"^%s==(?:.*\\\n)*.*\n" % re.escape(package), file.read(), re.MULTILINE)
    return str(lines)


def meet_native_needs() -> None:
    """Install the Debian packages that `harness doctor` finds missing; SetupError when needs remain."""
    missing = unmet_needs()
    packages = sorted({package for check in missing for package in check["apt"]})
    if packages:
        apt_install(packages, " and ".join(check["name"] for check in missing) + " cannot work yet")
        missing = unmet_needs()
    if missing:
        raise SetupError("\n".join("%s: %s\n    to mend: %s" % (check["name"], check["detail"], check["mend"])
                                   for check in missing))


def unmet_needs() -> List[Dict[str, Any]]:
    """The checks of `harness doctor` that are needed and fail."""
    doctor = subprocess.Popen([PYTHON, "-I", "-m", "harness", "doctor", "--json"], stdout=subprocess.PIPE)
    answer, _ = doctor.communicate()
    if doctor.returncode not in (0, EXIT_MACHINE):
        raise SetupError("`harness doctor` failed with status %d" % doctor.returncode)
    return [check for check in json.loads(answer.decode())["checks"] if check["needed"] and not check["ok"]]


def apt_install(packages: List[str], reason: str) -> None:
    """Install Debian packages where that needs no question; else SetupError with the line to type."""
    line = "apt-get install -y --no-install-recommends " + " ".join(packages)
    if os.geteuid() != 0 or shutil.which("apt-get") is None:
        prefix = "sudo " if shutil.which("sudo") else ""
        raise SetupError("%s; type as root\n    %s%s\nand then `make setup` again" % (reason, prefix, line))
    say("%s: installing %s" % (reason, " ".join(packages)))
    environment = dict(os.environ, DEBIAN_FRONTEND="noninteractive")
    if subprocess.call(line.split(), env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) == 0:
        return
    # The usual cause is a list of packages that is empty or old, as in a fresh container.
    subprocess.call(["apt-get", "update", "-q"], env=environment, stdout=subprocess.DEVNULL)
    if subprocess.call(line.split(), env=environment, stdout=subprocess.DEVNULL) != 0:
        raise SetupError("%s, and installing failed; type\n    %s\nand then `make setup` again" % (reason, line))


@contextlib.contextmanager
def one_at_a_time() -> Iterator[None]:
    """Holds a lock on the checkout's folder, so that no lock file is left behind."""
    import fcntl

    folder = os.open(ROOT, os.O_RDONLY)
    try:
        try:
            fcntl.flock(folder, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            say("waiting for another set-up in this folder")
            fcntl.flock(folder, fcntl.LOCK_EX)
        except OSError:
            pass  # a file system without locks
        yield
    finally:
        os.close(folder)


def run(command: List[str], failure: str) -> None:
    if subprocess.call(command) != 0:
        raise SetupError(failure)


def say(message: str) -> None:
    print("setup: " + message, file=sys.stderr, flush=True)


if __name__ == "__main__":
    sys.exit(main())
