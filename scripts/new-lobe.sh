#!/usr/bin/env bash
# make new-lobe NAME=x: a lobe's file, its rows, a test and a section of the manual. What is made
# builds, passes, and does nothing until its weight is set. See docs/EXTENDING.md.
