"""Several suspensions under one body: a whole aircraft, a car, a machine on isolators, a building on bearings."""
