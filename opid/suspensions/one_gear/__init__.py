"""One gear: the estimator that stands beside the general one until its tenants have moved."""
