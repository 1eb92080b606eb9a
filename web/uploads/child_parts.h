/* child_parts: how child.c tells child_launch.c what to do. */
#pragma once

/* azulejo-web COMMAND PARENT MEMORY PROCESSOR FILE WALL RESOLVES PROGRAM ARGUMENTS... */
#define CHILD_LAUNCH_COMMAND "launch-limited"
enum { CHILD_NUMBERS = 6, CHILD_LAUNCH_WORDS = CHILD_NUMBERS + 3 };
