"""Long imports as jobs: accepted at once, run by a process of their own, to be looked after and cancelled.

`spool` keeps what was sent, `runner` gives each job a process (`process`), a few at a time, and `kinds`
says what each kind of job does. The import and the end of its job are one transaction.
"""
