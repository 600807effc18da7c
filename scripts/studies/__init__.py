"""Studies behind `results/`: each module answers one question with a table and a picture."""
