"""Controllers commanded by hand: what a page's sliders and buttons send."""
