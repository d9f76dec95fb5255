"""A diagnosis for people: `diagnosis_html.report_html` makes an HTML file, `terminal.print_summary` a summary."""
