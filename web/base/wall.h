/* wall: what a program that reads strangers' files may do, from now on and in what it executes.
 *
 * - with Landlock (Linux 5.13): it reads the folder that it runs in, the system's libraries and its own standing in /proc
 *   and /sys; it writes and makes no file; it executes its own program only; with Linux 6.7 it connects to one TCP port only, and
 *   listens on none; with Linux 6.12 no signal and no abstract socket of its leaves it.
 * - with seccomp: no sockets but those of TCP; no listening, no tracing of processes, no namespaces, mounts, keys, BPF, io_uring.
 */
#pragma once

#include <linux/landlock.h>
#include <stddef.h>
#include <stdint.h>

#include "common/base/status.h"

struct wall {
    const char *program; /* that is executed next */
    uint16_t port;       /* that it may connect to */
    int resolves;        /* names: it may send datagrams */
};

/* What the kernel has of it, in words: "files, network, system calls"; "" : nothing. */
void wall_words(char *out, size_t size);
/* What it lacks, and which kernel would have it: "the network (Landlock of Linux 6.7)"; "": nothing. */
void wall_lacks(char *out, size_t size);
/* As much of it as the kernel has. 0: errno says why it failed. */
int wall_build(const struct wall *wall);

#define WALL_READS (LANDLOCK_ACCESS_FS_READ_FILE | LANDLOCK_ACCESS_FS_READ_DIR)
#define WALL_EXECUTES (LANDLOCK_ACCESS_FS_EXECUTE | LANDLOCK_ACCESS_FS_READ_FILE)
/* What can be allowed of a file that is no folder. */
#define WALL_OF_FILES (WALL_EXECUTES | LANDLOCK_ACCESS_FS_WRITE_FILE)

/* Allow Landlock's rules an access to what is below the path; what is not there needs no rule. 0: errno. */
int wall_allow(int rules, const char *path, uint64_t access);
/* Allow what every program reads of the system: libraries, time zones, names of machines, its own standing. 0: errno. */
int wall_allow_system(int rules);
