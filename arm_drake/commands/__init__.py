"""The commands of `arm-drake`: their words, and what they do."""
