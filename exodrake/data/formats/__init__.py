"""File formats of logs, a page each. `table.py` picks one by the file's ending."""
