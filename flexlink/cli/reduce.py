"""`flexlink reduce`: Find the fewest coordinates, by strain modes, that keep the tip within a tolerance.

flexlink reduce models/t3_spatial.toml --tip 2mm --set run.duration=0.5 -o small.toml
flexlink reduce models/t3_spatial.toml --tip 2mm --set run.duration=0.5 --for explicit
"""

from flexlink.cli import advise

run_command = advise.run_command
