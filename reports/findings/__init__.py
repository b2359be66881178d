"""Findings of the report: each generator of tables and sentences has the decorator `finding`, see `Makers`."""

from reports.chapters import Makers

finding = Makers()
finding.load(__path__, __name__)
