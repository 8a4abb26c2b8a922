"""Large tables: the diagnosis of subsamples that grow until the answer stays, and its test on all trials.

draw          rows that are even over objects, sequence and inputs
rounds        the subsamples one after the other, each no larger than memory allows
    kept          finished subsamples on disk
confirmation  errors, noise, outliers and failing regions of the full model, on all trials in chunks
"""
