"""What the log says, made rows for rules: of the log, the database and its clock."""
