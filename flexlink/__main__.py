"""`python -m flexlink` is the `flexlink` command."""

import sys

from flexlink.cli import main

sys.exit(main())
