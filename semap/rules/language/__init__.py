"""What a rule may say: YAML, patterns, formulas, conditions; read, checked and placed in the file."""
