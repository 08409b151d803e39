/* The rival of `compass bench latency`: the thesis' own architecture (chapter 3), three processes joined by LCM.
 *
 *   sensor:     reads a frame from a UNIX datagram socket, publishes 200 bytes on SENSOR
 *   controller: waits for SENSOR, computes a torque, publishes 200 bytes on COMMAND
 *   dispatch:   waits for COMMAND, writes a 16-byte CAN frame and its time of writing to a UNIX datagram socket
 *
 * The controller does less than Compass does in its tick (four products), and messages are raw bytes without
 * marshalling, so the comparison leans towards LCM. Each process takes the same priority and core that Compass' threads get.
 *
 * Usage: lcm_chain sensor|controller|dispatch SOCKET PRIORITY CORE        (SOCKET: "-" for the controller)
 * Build: cc -O2 -o lcm_chain lcm_chain.c -llcm
 */
#define _GNU_SOURCE
#include <lcm/lcm.h>
#include <sched.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <time.h>
#include <unistd.h>

#define URL "udpm://239.255.76.67:7667?ttl=0"
enum { MESSAGE_BYTES = 200 };

/* What travels: time when the driver sent the frame, its number, the measurement. */
struct payload {
    int64_t sent_ns;
    uint64_t number;
    double state[4];
    uint8_t rest[MESSAGE_BYTES - 48];
};

struct reply {
    int64_t sent_ns;
    uint64_t number;
    int64_t written_ns;
    uint8_t frame[16];
};

static int out_socket = -1;
static struct sockaddr_un out_address;

static int64_t now_ns(void) {
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return (int64_t)t.tv_sec * 1000000000 + t.tv_nsec;
}

static void real_time(int priority, int core) {
    struct sched_param p = {.sched_priority = priority};
    cpu_set_t set;
    CPU_ZERO(&set);
    CPU_SET(core, &set);
    if (mlockall(MCL_CURRENT | MCL_FUTURE) != 0) perror("mlockall");
    if (core >= 0 && sched_setaffinity(0, sizeof set, &set) != 0) perror("sched_setaffinity");
    if (priority > 0 && sched_setscheduler(0, SCHED_FIFO, &p) != 0) perror("sched_setscheduler");
}

static void on_sensor(const lcm_recv_buf_t *buf, const char *channel, void *user) {
    static const double gain[4] = {95.0, -8.2, 28.9, -0.96};
    struct payload p;
    (void)channel;
    if (buf->data_size < sizeof p) return;
    memcpy(&p, buf->data, sizeof p);
    double torque = 0;
    for (int i = 0; i < 4; i++) torque -= gain[i] * p.state[i];
    p.state[0] = torque;
    lcm_publish((lcm_t *)user, "COMMAND", &p, sizeof p);
}

static void on_command(const lcm_recv_buf_t *buf, const char *channel, void *user) {
    struct payload p;
    struct reply r = {0};
    (void)channel;
    (void)user;
    if (buf->data_size < sizeof p) return;
    memcpy(&p, buf->data, sizeof p);
    r.sent_ns = p.sent_ns;
    r.number = p.number;
    memcpy(r.frame, &p.state[0], sizeof(double));
    r.written_ns = now_ns();
    sendto(out_socket, &r, sizeof r, MSG_DONTWAIT, (struct sockaddr *)&out_address, sizeof out_address);
}

static int sensor(lcm_t *lcm, const char *path) {
    struct sockaddr_un a = {.sun_family = AF_UNIX};
    struct payload p;
    int s = socket(AF_UNIX, SOCK_DGRAM, 0);
    strncpy(a.sun_path, path, sizeof a.sun_path - 1);
    unlink(path);
    if (s < 0 || bind(s, (struct sockaddr *)&a, sizeof a) != 0) return perror("bind"), 1;
    for (;;) {
        if (recv(s, &p, sizeof p, 0) != (ssize_t)sizeof p) continue;
        lcm_publish(lcm, "SENSOR", &p, sizeof p);
    }
}

int main(int argc, char **argv) {
    if (argc != 5) {
        fprintf(stderr, "usage: lcm_chain sensor|controller|dispatch SOCKET PRIORITY CORE\n");
        return 2;
    }
    lcm_t *lcm = lcm_create(URL);
    if (!lcm) return fprintf(stderr, "no LCM: is multicast on lo? (ip link set lo multicast on; ip route add 224.0.0.0/4 dev lo)\n"), 3;
    real_time(atoi(argv[3]), atoi(argv[4]));
    if (strcmp(argv[1], "sensor") == 0) return sensor(lcm, argv[2]);
    if (strcmp(argv[1], "controller") == 0) {
        lcm_subscribe(lcm, "SENSOR", on_sensor, lcm);
    } else {
        out_socket = socket(AF_UNIX, SOCK_DGRAM, 0);
        out_address.sun_family = AF_UNIX;
        strncpy(out_address.sun_path, argv[2], sizeof out_address.sun_path - 1);
        lcm_subscribe(lcm, "COMMAND", on_command, NULL);
    }
    for (;;) lcm_handle(lcm);
}
