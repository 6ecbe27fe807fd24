"""Many rollouts at a time: parameter studies, and tests of many cases."""
