"""The subcommands of `arm-drake`."""
