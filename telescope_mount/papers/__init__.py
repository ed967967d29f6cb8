"""The experiments of the two papers, repeated with the product; nothing imports them."""
