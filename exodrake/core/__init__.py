"""Tools that every room needs: errors, files, schemas, processes, parallel loops, plugins."""
