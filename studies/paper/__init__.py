"""The paper beside exodrake: every figure and table with data behind it, from simulation, and a register of claims.

`page.reproduce` computes the chapters, a module each (`arms`, `equations`, `hardware`, `centres`, `estimation`,
`reach`); `page.page` sets them as one HTML page that needs nothing from outside; `page.claims_csv` is the register.

The paper is B. Kim, J. Ryu, K.-J. Cho, Sensors 20(10):2852, 2020. Nothing here was measured on the robot: every curve
is computed or simulated, and the page says so beside each.
"""
