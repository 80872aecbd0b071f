"""One convention of rows and timing of a record, for observer, identification, diagnosis and commissioning.

Row n is the control period that begins at t_n = n T (T the period [s]).

- Position, motor angle and current of row n are read at t_n.
- The command of row n is held from t_n to t_{n+1}; the current of row n + 1 answers it (`rows.of_row_before`).
- A current is read at the end of the period in which it flowed; `current` refers it to the instant, or to the period,
  that a balance needs.
- What the motor travelled follows from the back-EMF (`travel`), without a position reading.
"""
