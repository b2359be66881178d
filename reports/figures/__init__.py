"""Figures of the report: each generator of pictures from stored results has the decorator `figure`, see `Makers`."""

from reports.chapters import Makers

figure = Makers()
figure.load(__path__, __name__)
