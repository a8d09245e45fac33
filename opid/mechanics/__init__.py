"""What moves, when the law is known: laws, structures, their response, roads, sensors and a taxiing gear."""
