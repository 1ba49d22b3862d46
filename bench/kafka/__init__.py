"""A Kafka broker for tests and benchmarks: `./dev kafka` puts its libraries into .kafka."""
