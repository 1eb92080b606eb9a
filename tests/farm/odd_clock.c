/* odd_clock: preloaded into a program, gives it a wall clock that is wrong by as many seconds as the test says.
 *
 * ODD_CLOCK names a file of one int64_t, which is mapped and shared with the test. Durations stay right. With
 * ODD_CLOCK_OF_ALL what the program starts has the same clock.
 */
#include <dlfcn.h>
#include <fcntl.h>
#include <stdatomic.h>
#include <stdint.h>
#include <stdlib.h>
#include <sys/mman.h>
#include <time.h>
#include <unistd.h>

#define EXPORT __attribute__((visibility("default")))

static _Atomic int64_t *wrong_s;
static int (*real)(clockid_t, struct timespec *);

__attribute__((constructor)) static void begin(void)
{
    const char *path = getenv("ODD_CLOCK");
    int fd = path ? open(path, O_RDONLY | O_CLOEXEC) : -1;
    void *map = fd >= 0 ? mmap(NULL, sizeof *wrong_s, PROT_READ, MAP_SHARED, fd, 0) : MAP_FAILED;

    if (fd >= 0)
        close(fd);
    if (map != MAP_FAILED)
        wrong_s = map;
    *(void **)&real = dlsym(RTLD_NEXT, "clock_gettime");
    if (!getenv("ODD_CLOCK_OF_ALL"))
        unsetenv("LD_PRELOAD"); /* the page's program is not meant */
}

EXPORT int clock_gettime(clockid_t id, struct timespec *out)
{
    int code = real ? real(id, out) : -1;

    if (code == 0 && id == CLOCK_REALTIME && wrong_s)
        out->tv_sec += *wrong_s;
    return code;
}

EXPORT time_t time(time_t *out)
{
    struct timespec now = {0};

    clock_gettime(CLOCK_REALTIME, &now);
    if (out)
        *out = now.tv_sec;
    return now.tv_sec;
}
