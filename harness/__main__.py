"""python -m harness COMMAND"""

import os
import sys

from harness.command.main import main
from harness.machine.wait_policy import wait_policy
from scenes.files.installed import packages_needed
from scenes.files.standard_output import go_on_unheard
from scenes.files.stopping import stop_on_signals

if __name__ == "__main__":
    os.environ.update(wait_policy(os.environ))  # before torch is imported; every process that is started inherits it
    go_on_unheard()
    stop_on_signals()
    with packages_needed():
        code = main(sys.argv[1:])
    sys.stderr.flush()
    # without the interpreter's teardown, in which OpenImageIO's bindings print warnings that no user asked for
    os._exit(code)
