"""Runs the README's examples: every block of shell commands that <!-- run --> or <!-- run in the background -->
announces, in order, in an empty folder. Where it may, in a network of its own, since the addresses are the default
ones."""

import os
import re
import subprocess
import sys
import tempfile

ROOT = os.path.dirname(os.path.dirname(os.path.dirname(os.path.abspath(__file__))))
NETWORK = ["unshare", "-rn", "sh", "-c", "ip link set lo up && exec \"$@\"", "sh"]


def script():
    with open(os.path.join(ROOT, "README.md")) as stream:
        readme = stream.read()
    blocks = re.findall(r"<!-- (run|run in the background) -->\n+```sh\n(.*?)```", readme, re.S)
    assert len(blocks) >= 5, "the README's examples are not found"
    lines = ["set -e", "trap 'kill $(jobs -p) 2>/dev/null || true' EXIT"]
    for kind, commands in blocks:
        # What a block says about its output is not a command.
        lines += [f"echo '== ' {commands.splitlines()[0]!r}"]
        lines += [f"({commands.strip()}) & sleep 3" if kind != "run" else commands]
    return "\n".join(lines)


def main():
    if subprocess.run([*NETWORK, "true"], capture_output=True).returncode == 0 and "--inside" not in sys.argv:
        sys.exit(subprocess.run([*NETWORK, sys.executable, __file__, "--inside"]).returncode)
    path = os.path.dirname(os.environ["ATOMCAM"]) + os.pathsep + os.environ["PATH"]
    with tempfile.TemporaryDirectory() as folder:
        result = subprocess.run(["bash", "-c", script()], cwd=folder, env={**os.environ, "PATH": path})
        sys.exit(result.returncode)


if __name__ == "__main__":
    main()
