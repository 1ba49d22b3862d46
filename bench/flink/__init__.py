"""Apache Flink as a second opinion: where it is, and the programs that ask it.

`./dev flink` puts its libraries into .flink where there is a JDK 17 or newer, and beside them a Python with
PyFlink. semap itself needs none.
"""
