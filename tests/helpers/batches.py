"""Batches of fits in a folder, and what they leave there."""

import csv

from dsbrdf import batch

OPTIONS = {"n_lobes": 1}


def run(folder, out, **options):
    targets, _ = batch.expand([folder])
    return batch.fit_many(targets, out, **(OPTIONS | options))


def table(out):
    with (out / "fits.csv").open(newline="") as file:
        return list(csv.DictReader(file))


def files_in(folder):
    return sorted(path.name for path in folder.iterdir())
