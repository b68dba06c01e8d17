"""The interactive explorer: a local web page of a dataset, its truth and the answers of methods.

Move over a picture, and the other one shows at once where the point truly is, what each method
answers, its heat map and its confidence. The page is served to this machine alone.
"""
