#include "common/system/machine.h"

#include <fcntl.h>
#include <limits.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <unistd.h>

/* The first bytes of a small file as a string; 0 when it cannot be read. */
static int read_text(const char *path, char *out, size_t size)
{
    int fd = open(path, O_RDONLY | O_CLOEXEC);
    ssize_t got;

    if (fd < 0)
        return 0;
    got = read(fd, out, size - 1);
    close(fd);
    if (got <= 0)
        return 0;
    out[got] = '\0';
    return 1;
}

/* The only number in a file ("max" is not a number). */
static uint64_t read_number(const char *path)
{
    char text[64], *end;
    unsigned long long value;

    if (!read_text(path, text, sizeof text))
        return UINT64_MAX;
    value = strtoull(text, &end, 10);
    return end == text ? UINT64_MAX : value;
}

static uint64_t kernel_available(void)
{
    char text[4096];
    const char *line;

    if (!read_text("/proc/meminfo", text, sizeof text))
        return UINT64_MAX;
    line = strstr(text, "MemAvailable:");
    return line ? strtoull(line + strlen("MemAvailable:"), NULL, 10) * 1024 : UINT64_MAX;
}

/* The number after `key` in a table of "key number" lines; 0 if the key is missing. */
static uint64_t table_number(const char *path, const char *key)
{
    char text[4096];
    size_t length = strlen(key);

    if (!read_text(path, text, sizeof text))
        return 0;
    for (const char *line = text; line; line = strchr(line, '\n')) {
        line += *line == '\n';
        if (strncmp(line, key, length) == 0 && line[length] == ' ')
            return strtoull(line + length, NULL, 10);
    }
    return 0;
}

/* What a control group's limit leaves: its page cache can be evicted. */
static uint64_t group_available(const char *folder, const char *limit_name, const char *usage_name,
                                const char *cache_key)
{
    char path[PATH_MAX];
    uint64_t limit, usage, cache;

    snprintf(path, sizeof path, "%s/%s", folder, limit_name);
    limit = read_number(path);
    snprintf(path, sizeof path, "%s/%s", folder, usage_name);
    usage = read_number(path);
    if (limit == UINT64_MAX || usage == UINT64_MAX)
        return UINT64_MAX;
    snprintf(path, sizeof path, "%s/memory.stat", folder);
    cache = table_number(path, cache_key);
    usage -= cache < usage ? cache : usage;
    return limit > usage ? limit - usage : 0;
}

static uint64_t least(uint64_t a, uint64_t b) { return a < b ? a : b; }

static uint64_t group_limit(const char *folder, const char *limit_name, const char *usage_name, const char *cache_key)
{
    char path[PATH_MAX + 64];

    (void)usage_name;
    (void)cache_key;
    snprintf(path, sizeof path, "%s/%s", folder, limit_name);
    return read_number(path);
}

/* The least that `ask` says of this process's groups. Version 2: its group and all above it, up to the root
 * (in a container, the process's own); version 1: the root as a container sees it. */
static uint64_t groups_least(uint64_t (*ask)(const char *folder, const char *limit_name, const char *usage_name,
                                             const char *cache_key))
{
    static const char root[] = "/sys/fs/cgroup";
    uint64_t available = ask("/sys/fs/cgroup/memory", "memory.limit_in_bytes", "memory.usage_in_bytes", "total_cache");
    char text[4096], folder[sizeof text + sizeof root], *own, *end;

    if (!read_text("/proc/self/cgroup", text, sizeof text))
        return available;
    own = strncmp(text, "0::/", 4) == 0 ? text + 3 : strstr(text, "\n0::/");
    if (own && *own == '\n')
        own += 4;
    if (own && (end = strchr(own, '\n')))
        *end = '\0';
    snprintf(folder, sizeof folder, "%s%s", root, own ? own : "");
    while (strlen(folder) >= strlen(root)) {
        available = least(available, ask(folder, "memory.max", "memory.current", "file"));
        *strrchr(folder, '/') = '\0';
    }
    return available;
}

static uint64_t address_space_available(void)
{
    struct rlimit limit;
    char text[256];
    uint64_t used;

    if (getrlimit(RLIMIT_AS, &limit) != 0 || limit.rlim_cur == RLIM_INFINITY)
        return UINT64_MAX;
    if (!read_text("/proc/self/statm", text, sizeof text))
        return limit.rlim_cur;
    used = strtoull(text, NULL, 10) * (uint64_t)sysconf(_SC_PAGESIZE);
    return limit.rlim_cur > used ? limit.rlim_cur - used : 0;
}

uint64_t machine_memory_available(void)
{
    return least(least(kernel_available(), groups_least(group_available)), address_space_available());
}

uint64_t machine_memory_total(void)
{
    long pages = sysconf(_SC_PHYS_PAGES), page = sysconf(_SC_PAGESIZE);
    uint64_t machine = pages > 0 && page > 0 ? (uint64_t)pages * (uint64_t)page : UINT64_MAX;
    uint64_t total = least(machine, groups_least(group_limit));

    return total == UINT64_MAX ? 0 : total;
}
