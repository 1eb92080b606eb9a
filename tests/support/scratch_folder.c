#include "tests/support/scratch_folder.h"

#include <stdio.h>
#include <stdlib.h>
#include <sys/statvfs.h>
#include <unistd.h>

#define MEMORY "/dev/shm"
enum { ROOM_MIB = 256 }; /* more than any test writes */

void scratch_folder(char *path)
{
    struct statvfs room;
    int in_memory =
        access(MEMORY, W_OK) == 0 && statvfs(MEMORY, &room) == 0 && (room.f_bavail * room.f_frsize) >> 20 >= ROOM_MIB;

    snprintf(path, SCRATCH_PATH, "%s/azulejo-test-XXXXXX", in_memory ? MEMORY : "/tmp");
    if (!mkdtemp(path)) {
        perror(path);
        abort();
    }
}
