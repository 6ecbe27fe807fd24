"""Our simulation of robots beside other engines': same work, one run, in turns."""
