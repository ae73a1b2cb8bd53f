/* Makes writes to files below a folder fail: preload it, with the folder in FAULTY_FOLDER and a control file of three
 * 32-bit integers in FAULTY_CONTROL, which another process may change at any time:
 *
 *   kind   0: no fault; above 0: the number of the error; -1: half of the bytes are written, after that EIO; -2: calls hang
 *   skip   writes that still succeed
 *   count  writes that fail after them; -1: all
 *
 * The creation of a file or folder, fdatasync(), fsync() and ftruncate() count as writes; a disk that hangs does so in
 * the last three as well. */

#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <stdarg.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

enum { NONE = 0, HALF = -1, HANG = -2 };

static volatile int32_t *control;

static void find_control(void) {
    const char *path = getenv("FAULTY_CONTROL");
    int file = path ? open(path, O_RDWR | O_CLOEXEC) : -1;
    if (file < 0) return;
    void *mapped = mmap(NULL, 3 * sizeof(int32_t), PROT_READ | PROT_WRITE, MAP_SHARED, file, 0);
    close(file);
    if (mapped != MAP_FAILED) control = mapped;
}

static int concerned(int file) {
    if (!control) find_control();
    const char *folder = getenv("FAULTY_FOLDER");
    struct stat about;
    char name[64], path[4096];
    if (!control || !folder || control[0] == NONE || fstat(file, &about) || !S_ISREG(about.st_mode)) return 0;
    snprintf(name, sizeof name, "/proc/self/fd/%d", file);
    ssize_t length = readlink(name, path, sizeof path - 1);
    if (length < 0) return 0;
    path[length] = 0;
    return strncmp(path, folder, strlen(folder)) == 0;
}

static int is_below_folder(const char *path) {
    const char *folder = getenv("FAULTY_FOLDER");
    if (!control) find_control();
    return control && folder && control[0] > NONE && strncmp(path, folder, strlen(folder)) == 0;
}

static int is_due(void) {
    if (__atomic_fetch_sub(&control[1], 1, __ATOMIC_SEQ_CST) > 0) return 0;
    if (control[2] < 0) return 1;
    return __atomic_fetch_sub(&control[2], 1, __ATOMIC_SEQ_CST) > 0;
}

static void hang_if_asked(int file) {
    while (concerned(file) && control[0] == HANG && control[1] <= 0) usleep(10000);
}

static int fails(int file) {
    return concerned(file) && is_due();
}

/* The number of bytes that may be written, or -1 with errno. */
static ssize_t permitted(int file, size_t length) {
    if (!fails(file)) return length;
    if (control[0] == HANG) hang_if_asked(file);
    else if (control[0] == HALF && length > 1) {
        control[0] = EIO;
        return length / 2;
    } else {
        errno = control[0] > 0 ? control[0] : EIO;
        return -1;
    }
    return length;
}

ssize_t write(int file, const void *data, size_t length) {
    static ssize_t (*original)(int, const void *, size_t);
    if (!original) original = (ssize_t(*)(int, const void *, size_t))dlsym(RTLD_NEXT, "write");
    ssize_t most = permitted(file, length);
    return most < 0 ? most : original(file, data, most);
}

ssize_t pwrite64(int file, const void *data, size_t length, off64_t offset) {
    static ssize_t (*original)(int, const void *, size_t, off64_t);
    if (!original) original = (ssize_t(*)(int, const void *, size_t, off64_t))dlsym(RTLD_NEXT, "pwrite64");
    ssize_t most = permitted(file, length);
    return most < 0 ? most : original(file, data, most, offset);
}

ssize_t pwrite(int file, const void *data, size_t length, off_t offset) { return pwrite64(file, data, length, offset); }

/* Whether a call that takes no data fails; with errno if it does. */
static int call_fails(int file) {
    hang_if_asked(file);
    if (!control || control[0] <= NONE || !fails(file)) return 0;
    errno = control[0];
    return 1;
}

int fdatasync(int file) {
    static int (*original)(int);
    if (!original) original = (int (*)(int))dlsym(RTLD_NEXT, "fdatasync");
    return call_fails(file) ? -1 : original(file);
}

int fsync(int file) {
    static int (*original)(int);
    if (!original) original = (int (*)(int))dlsym(RTLD_NEXT, "fsync");
    return call_fails(file) ? -1 : original(file);
}

int ftruncate(int file, off_t length) {
    static int (*original)(int, off_t);
    if (!original) original = (int (*)(int, off_t))dlsym(RTLD_NEXT, "ftruncate");
    return call_fails(file) ? -1 : original(file, length);
}

int ftruncate64(int file, off64_t length) { return ftruncate(file, length); }

/* Whether a file or folder may be created; with errno if not. */
static int creation_fails(const char *path) {
    if (!is_below_folder(path) || !is_due()) return 0;
    errno = control[0];
    return 1;
}

int open64(const char *path, int flags, ...) {
    static int (*original)(const char *, int, ...);
    if (!original) original = (int (*)(const char *, int, ...))dlsym(RTLD_NEXT, "open64");
    va_list arguments;
    va_start(arguments, flags);
    mode_t mode = flags & O_CREAT ? va_arg(arguments, mode_t) : 0;
    va_end(arguments);
    if (flags & O_CREAT && creation_fails(path)) return -1;
    return original(path, flags, mode);
}

int mkdir(const char *path, mode_t mode) {
    static int (*original)(const char *, mode_t);
    if (!original) original = (int (*)(const char *, mode_t))dlsym(RTLD_NEXT, "mkdir");
    return creation_fails(path) ? -1 : original(path, mode);
}
