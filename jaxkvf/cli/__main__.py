"""`python -m jaxkvf.cli`, where the command `jaxkvf` is not on the path."""

import sys

from ._main import main

sys.exit(main())
