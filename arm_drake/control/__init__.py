"""The mathematics that controllers share: arrays in, arrays out, no ports."""
