"""What a reader gets: text, markdown, LaTeX and figures made from results, nothing computed."""
