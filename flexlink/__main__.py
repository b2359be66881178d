"""`python -m flexlink` is the `flexlink` command."""

import sys

from flexlink.cli.main import main

sys.exit(main())
