"""Rules on Apache Flink: `job` runs in an interpreter of Flink's, and needs no more of semap than rules."""
