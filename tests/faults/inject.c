/* Counts the system calls by which a program changes files below FAULT_FOLDER and opens files there, and makes one of
   them fail (FAULT_KIND=error), it and every later one that needs room on the disk (full), ends the program there (kill), or asks it to
   end (signal, FAULT_SIGNAL).
   FAULT_AT is the number of the call, from 1; the count is written to FAULT_COUNT when the program ends. */

#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <signal.h>
#include <stdarg.h>
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/syscall.h>
#include <sys/uio.h>
#include <unistd.h>

static atomic_long calls;
static const char *folder, *kind;
static long at;
static int log_fd = -1;

__attribute__((constructor)) static void begin(void) {
    folder = getenv("FAULT_FOLDER");
    /* Other programs that this one starts run without faults. */
    unsetenv("LD_PRELOAD");
    kind = getenv("FAULT_KIND");
    at = getenv("FAULT_AT") ? atol(getenv("FAULT_AT")) : 0;
    if (getenv("FAULT_COUNT"))
        log_fd = (int)syscall(SYS_openat, AT_FDCWD, getenv("FAULT_COUNT"), O_WRONLY | O_CREAT | O_TRUNC, 0644);
}

/* What was called at which number: one line per call. */
static void note(long number, const char *name, const char *path) {
    char line[PATH_MAX + 64];
    int length = snprintf(line, sizeof line, "%ld %s %s\n", number, name, path);
    if (log_fd >= 0 && length > 0)
        syscall(SYS_write, log_fd, line, (size_t)length);
}

/* The error that a call is to have, or 0; does not come back from the call where the program ends. */
static int fault(const char *name, const char *path, int needs_room) {
    if (!folder || strncmp(path, folder, strlen(folder)) != 0)
        return 0;
    long number = atomic_fetch_add(&calls, 1) + 1;
    note(number, name, path);
    if (!at || !kind)
        return 0;
    if (strcmp(kind, "kill") == 0 && number == at)
        kill(getpid(), SIGKILL), pause();
    if (strcmp(kind, "signal") == 0 && number == at) {
        kill(getpid(), atoi(getenv("FAULT_SIGNAL")));
        /* Long enough for the program to end, unless it must not here. */
        usleep(100000);
    }
    if (strcmp(kind, "error") == 0 && number == at)
        return EIO;
    if (strcmp(kind, "full") == 0 && number >= at && needs_room)
        return ENOSPC;
    return 0;
}

static int fault_of_name(const char *name, int dir, const char *path, int needs_room) {
    char full[PATH_MAX];
    if (path[0] != '/') {
        char link[64], base[PATH_MAX];
        if (dir == AT_FDCWD) {
            if (!getcwd(base, sizeof base))
                return 0;
        } else {
            snprintf(link, sizeof link, "/proc/self/fd/%d", dir);
            ssize_t length = readlink(link, base, sizeof base - 1);
            if (length < 0)
                return 0;
            base[length] = 0;
        }
        snprintf(full, sizeof full, "%.2000s/%.2000s", base, path);
        path = full;
    }
    return fault(name, path, needs_room);
}

static int fault_of_file(const char *name, int fd, int needs_room) {
    char link[64], path[PATH_MAX];
    snprintf(link, sizeof link, "/proc/self/fd/%d", fd);
    ssize_t length = readlink(link, path, sizeof path - 1);
    if (length < 0)
        return 0;
    path[length] = 0;
    return fault(name, path, needs_room);
}

#define REAL(name) ((__typeof__(&name))dlsym(RTLD_NEXT, #name))
#define FAIL_OR(error, call) do { int e = (error); if (e) { errno = e; return -1; } return call; } while (0)

#define OPEN(name)                                                                                       \
    int name(const char *path, int flags, ...) {                                                         \
        va_list list;                                                                                    \
        va_start(list, flags);                                                                           \
        int mode = flags & (O_CREAT | __O_TMPFILE) ? va_arg(list, int) : 0;                              \
        va_end(list);                                                                                    \
        FAIL_OR(fault_of_name("open", AT_FDCWD, path, flags & O_CREAT), REAL(name)(path, flags, mode)); \
    }
#define OPENAT(name)                                                                                     \
    int name(int dir, const char *path, int flags, ...) {                                                \
        va_list list;                                                                                    \
        va_start(list, flags);                                                                           \
        int mode = flags & (O_CREAT | __O_TMPFILE) ? va_arg(list, int) : 0;                              \
        va_end(list);                                                                                    \
        FAIL_OR(fault_of_name("open", dir, path, flags & O_CREAT), REAL(name)(dir, path, flags, mode));  \
    }
OPEN(open)
OPEN(open64)
OPENAT(openat)
OPENAT(openat64)

ssize_t write(int fd, const void *bytes, size_t count) {
    FAIL_OR(fault_of_file("write", fd, 1), REAL(write)(fd, bytes, count));
}
ssize_t writev(int fd, const struct iovec *parts, int count) {
    FAIL_OR(fault_of_file("write", fd, 1), REAL(writev)(fd, parts, count));
}
ssize_t copy_file_range(int from, off64_t *from_at, int to, off64_t *to_at, size_t count, unsigned flags) {
    FAIL_OR(fault_of_file("write", to, 1), REAL(copy_file_range)(from, from_at, to, to_at, count, flags));
}
int fsync(int fd) {
    FAIL_OR(fault_of_file("fsync", fd, 0), REAL(fsync)(fd));
}
int fdatasync(int fd) {
    FAIL_OR(fault_of_file("fsync", fd, 0), REAL(fdatasync)(fd));
}
int rename(const char *from, const char *to) {
    FAIL_OR(fault_of_name("rename", AT_FDCWD, to, 0), REAL(rename)(from, to));
}
int renameat(int from_dir, const char *from, int to_dir, const char *to) {
    FAIL_OR(fault_of_name("rename", to_dir, to, 0), REAL(renameat)(from_dir, from, to_dir, to));
}
int link(const char *from, const char *to) {
    FAIL_OR(fault_of_name("rename", AT_FDCWD, to, 1), REAL(link)(from, to));
}
int linkat(int from_dir, const char *from, int to_dir, const char *to, int flags) {
    FAIL_OR(fault_of_name("rename", to_dir, to, 1), REAL(linkat)(from_dir, from, to_dir, to, flags));
}
int mkdir(const char *path, mode_t mode) {
    FAIL_OR(fault_of_name("mkdir", AT_FDCWD, path, 1), REAL(mkdir)(path, mode));
}
int rmdir(const char *path) {
    FAIL_OR(fault_of_name("unlink", AT_FDCWD, path, 0), REAL(rmdir)(path));
}
int unlinkat(int dir, const char *path, int flags) {
    FAIL_OR(fault_of_name("unlink", dir, path, 0), REAL(unlinkat)(dir, path, flags));
}
int unlink(const char *path) {
    FAIL_OR(fault_of_name("unlink", AT_FDCWD, path, 0), REAL(unlink)(path));
}
