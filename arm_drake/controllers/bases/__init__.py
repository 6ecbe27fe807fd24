"""The controllers of mobile bases."""
