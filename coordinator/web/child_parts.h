/* child_parts: how child.c tells child_launch.c what to do. */
#ifndef AZULEJO_COORDINATOR_WEB_CHILD_PARTS_H
#define AZULEJO_COORDINATOR_WEB_CHILD_PARTS_H

/* azulejo-coordinator COMMAND PARENT MEMORY PROCESSOR FILE PROGRAM ARGUMENTS... */
#define CHILD_LAUNCH_COMMAND "launch-limited"
enum { CHILD_LAUNCH_WORDS = 7 };

#endif
