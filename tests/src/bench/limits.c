/* The raw limits of the benchmarks: what the system and a few lines of C can do, with nothing around it. */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <linux/futex.h>
#include <pthread.h>
#include <sched.h>
#include <semaphore.h>
#include <setjmp.h>
#include <signal.h>
#include <stdatomic.h>
#include <stddef.h>
#include <stdint.h>
#include <sys/syscall.h>
#include <time.h>
#include <unistd.h>

typedef int (*set_action)(int, const struct sigaction *, struct sigaction *);

static _Thread_local sigjmp_buf back;
static _Thread_local uint64_t began;

static uint64_t now(void)
{
    struct timespec time;
    clock_gettime(CLOCK_MONOTONIC, &time);
    return (uint64_t)time.tv_sec * 1000000000u + (uint64_t)time.tv_nsec;
}

static void jump(int signal, siginfo_t *info, void *context)
{
    (void)signal, (void)info, (void)context;
    siglongjmp(back, 1);
}

/* The C library's own: the executable may have put its shield before it. */
static void handle(int signal, const struct sigaction *action, struct sigaction *old)
{
    static set_action real;
    if (real == NULL)
        *(void **)&real = dlsym(RTLD_NEXT, "sigaction");
    real(signal, action, old);
}

static struct sigaction jumping(void)
{
    struct sigaction action = {.sa_sigaction = jump, .sa_flags = SA_SIGINFO | SA_ONSTACK | SA_NODEFER};
    return action;
}

/* Volatile itself: the compiler is not to see where it leads. */
static volatile uint32_t *volatile nowhere = (volatile uint32_t *)8;

/* SIGSEGV, siglongjmp without a mask, a call: nanoseconds. The handler is ours only meanwhile. */
uint64_t limit_trap(void (*call)(void))
{
    struct sigaction action = jumping(), old;
    handle(SIGSEGV, &action, &old);
    if (sigsetjmp(back, 0) == 0) {
        began = now();
        *nowhere = 1;
    }
    call();
    uint64_t took = now() - began;
    handle(SIGSEGV, &old, NULL);
    return took;
}

/* SIGSEGV, whose handler writes those bytes to that descriptor: nanoseconds until they are written. */
static _Thread_local int line;
static _Thread_local const void *words;
static _Thread_local size_t length;
static _Thread_local uint64_t written_at;

static void write_and_jump(int signal, siginfo_t *info, void *context)
{
    (void)signal, (void)info, (void)context;
    if (write(line, words, length) == (ssize_t)length)
        written_at = now();
    siglongjmp(back, 1);
}

uint64_t limit_trap_and_write(int fd, const void *bytes, size_t count)
{
    struct sigaction action = {.sa_sigaction = write_and_jump, .sa_flags = SA_SIGINFO | SA_ONSTACK | SA_NODEFER}, old;
    line = fd, words = bytes, length = count;
    handle(SIGSEGV, &action, &old);
    if (sigsetjmp(back, 0) == 0) {
        began = now();
        *nowhere = 1;
    }
    handle(SIGSEGV, &old, NULL);
    return written_at - began;
}

/* A watchdog and what it watches. */
static sem_t armed;
static _Atomic uint64_t deadline;
static _Atomic pid_t worker;

static int signal_of_watchdog(void)
{
    return SIGRTMIN + 7;
}

/* Keeps that thread on that processor, where there is one. */
void limit_keep_on(int thread, int processor)
{
    cpu_set_t set;
    CPU_ZERO(&set);
    CPU_SET(processor, &set);
    sched_setaffinity(thread, sizeof set, &set);
}

/* Once, before anything else. */
void limit_watch_prepare(void)
{
    struct sigaction action = jumping();
    sem_init(&armed, 0, 0);
    handle(signal_of_watchdog(), &action, NULL);
}

/* The watchdog's thread: waits for a deadline, then signals whoever is beyond it. Ends at a deadline of 0. */
void limit_watchdog(void)
{
    for (;;) {
        while (sem_wait(&armed) != 0) {
        }
        uint64_t at = atomic_load(&deadline);
        if (at == 0)
            return;
        struct timespec time = {.tv_sec = (time_t)(at / 1000000000u), .tv_nsec = (long)(at % 1000000000u)};
        while (clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &time, NULL) != 0) {
        }
        syscall(SYS_tgkill, getpid(), atomic_load(&worker), signal_of_watchdog());
    }
}

/* Spins until the watchdog signals after `budget` nanoseconds, jumps out, calls: nanoseconds after the deadline. */
uint64_t limit_hang(uint64_t budget, void (*call)(void))
{
    atomic_store(&worker, (pid_t)syscall(SYS_gettid));
    if (sigsetjmp(back, 0) == 0) {
        began = now() + budget;
        atomic_store(&deadline, began);
        sem_post(&armed);
        for (;;) {
            atomic_signal_fence(memory_order_seq_cst);
        }
    }
    call();
    return now() - began;
}

/* Ends the watchdog's thread. */
void limit_watch_end(void)
{
    atomic_store(&deadline, 0);
    sem_post(&armed);
}

/* What a hop is compared with: a function by its address, and the copy of 64 bytes. */
void limit_copy(void (*call)(void), volatile uint64_t *to, const volatile uint64_t *from, uint64_t times)
{
    void (*volatile address)(void) = call;
    for (uint64_t time = 0; time < times; time++) {
        address();
        for (int word = 0; word < 8; word++)
            to[word] = from[word];
    }
}

/* Two threads on the first two processors that wake each other, each asleep until then. */
static _Atomic uint32_t ball;
static uint64_t hit_ns;

static void stay_on(int processor)
{
    limit_keep_on(0, processor);
}

static void hit(uint32_t to)
{
    hit_ns = now();
    atomic_store(&ball, to);
    syscall(SYS_futex, &ball, FUTEX_WAKE_PRIVATE, 1, NULL, NULL, 0);
}

/* Nanoseconds from the other's hit to here. */
static uint64_t take(uint32_t mine)
{
    uint32_t seen;
    while ((seen = atomic_load(&ball)) != mine)
        syscall(SYS_futex, &ball, FUTEX_WAIT_PRIVATE, seen, NULL, NULL, 0);
    return now() - hit_ns;
}

static struct timespec rest;

static void sleep_a_while(void)
{
    if (rest.tv_nsec > 0)
        nanosleep(&rest, NULL);
}

static void *other_side(void *rounds)
{
    stay_on(1);
    for (uint64_t round = 0; round < (uint64_t)rounds; round++) {
        take(1);
        sleep_a_while();
        hit(2);
    }
    return NULL;
}

/* Fills `figures` with the nanoseconds of that many wake-ups, each after a pause of less than a second; the calling thread stays on its processor meanwhile. */
int limit_wake(uint64_t *figures, uint64_t rounds, uint64_t pause_ns)
{
    pthread_t other;
    cpu_set_t before;
    sched_getaffinity(0, sizeof before, &before);
    atomic_store(&ball, 0);
    rest.tv_nsec = (long)pause_ns;
    if (pthread_create(&other, NULL, other_side, (void *)rounds) != 0)
        return 0;
    stay_on(0);
    for (uint64_t round = 0; round < rounds; round++) {
        sleep_a_while();
        hit(1);
        figures[round] = take(2);
    }
    pthread_join(other, NULL);
    sched_setaffinity(0, sizeof before, &before);
    return 1;
}
