"""Run time against error of every way to compute a gated frame: variants, baselines, measuring, reporting."""
