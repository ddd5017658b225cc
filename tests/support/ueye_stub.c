/* The part of IDS' uEye library that the driver uses, as strict as the vendor's manual: ranges, order, and a camera that
 * freezes when clock, exposure or region of interest are set while it is live. Every frame carries the settings that made
 * it in its first pixels. stub_* are for the tests. */
#include <errno.h>
#include <pthread.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

#define SUCCESS 0
#define INVALID_HANDLE 1
#define IO_FAILED 2
#define CANT_OPEN 3
#define TIMED_OUT 122
#define INVALID_PARAMETER 125
#define CAPTURE_RUNNING 140
#define NOT_SUPPORTED 155
#define BAD_SIZE 158
#define IN_USE 178
#define MEMORIES 64
#define CLOCKS_PER_LINE 996.67

#pragma pack(push, 8)
typedef struct { uint32_t camera, device, sensor, in_use; char serial[16], model[16]; uint32_t status, r1[2];
                 char full[32]; uint32_t r2[5]; } CameraInfo;
typedef struct { uint32_t count; CameraInfo cameras[1]; } CameraList;
typedef struct { uint16_t id; char name[32], mode; uint32_t width, height; int32_t gains[4], global; uint16_t pitch;
                 char bayer, reserved[13]; } SensorInfo;
typedef struct { uint32_t flags; uint8_t r1[4]; int64_t device_time; uint16_t time[7]; uint8_t r2[10]; uint32_t io;
                 uint16_t aoi[2]; int64_t frame; uint32_t buffers, in_use, r3, height, width, host, seq, focus; int32_t f;
                 uint32_t r4; } ImageInfo;
typedef struct { int32_t x, y, w, h; } Rect;
typedef struct { uint32_t timeout_ms; char **address; int *number; } WaitBuffer;
#pragma pack(pop)

typedef struct { uint16_t *data; int width, height, bits, pitch, listed, locked, queued; int64_t frame, made; } Memory;

static pthread_mutex_t lock = PTHREAD_MUTEX_INITIALIZER;
static pthread_cond_t arrived = PTHREAD_COND_INITIALIZER;
static int plugged = 1, opened, live, frozen, alive, faults, mosaic = 1, bits = 8, shutter = 2, trigger, clock_mhz = 30;
static int delay_us, queue_ready, next_memory, order[MEMORIES], order_count, trigger_hz = 60, opens, most_memories;
static double exposure_ms = 10, fps = 10;
static int64_t frame;
static Rect area = {0, 0, 1600, 1200};
static Memory memories[MEMORIES];
static pthread_t thread;
static char complaint[256];

static int fault(const char *what)
{
    faults++;
    snprintf(complaint, sizeof complaint, "%s", what);
    return INVALID_PARAMETER;
}

static int ready(unsigned handle)
{
    if (!plugged) return IO_FAILED;
    return opened && handle == 1 ? SUCCESS : INVALID_HANDLE;
}

static double line_us(void) { return CLOCKS_PER_LINE / clock_mhz; }
static double shortest_s(void) { return (area.h + 12) * line_us() * 1e-6; }
static double longest_ms(void) { return trigger ? 2000.0 : 1000.0 / fps; }

static int clock_allowed(int mhz)
{
    return (mhz >= 10 && mhz <= 50) || (mhz <= 100 && mhz > 50 && mhz % 2 == 0) || (mhz > 100 && mhz <= 128 && mhz % 4 == 0);
}

static void round_exposure(double wanted_ms)
{
    double line_ms = line_us() * 1e-3, rows = (double)(long)(wanted_ms / line_ms + 0.5);
    exposure_ms = (rows < 1 ? 1 : rows) * line_ms;
    if (exposure_ms > longest_ms()) exposure_ms = longest_ms();
}

/* The camera's clock, which began to run when nobody looked: 0.1 microseconds. */
static int64_t ticks(void)
{
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return 77 + now.tv_sec * 10000000LL + now.tv_nsec / 100;
}

static void make_frame(void)
{
    int k;
    frame++;
    for (k = 0; k < MEMORIES; k++) {
        Memory *m = &memories[next_memory = (next_memory + 1) % MEMORIES];
        if (!m->listed || m->locked || m->queued) continue;
        uint32_t e = (uint32_t)(exposure_ms * 1e3 + 0.5), values[8] = {e & 4095, e >> 12, delay_us & 4095, delay_us >> 12,
            clock_mhz, frame & 4095, area.y, shutter};
        for (int r = 0; r < m->height; r++)
            for (int c = 0; c < m->width; c++) {
                int value = r == 0 && c < 8 ? (int)values[c] : (r * 7 + c) & 4095;
                if (m->bits == 16) ((uint16_t *)((char *)m->data + r * m->pitch))[c] = value;
                else ((uint8_t *)m->data + r * m->pitch)[c] = value;
            }
        m->frame = frame;
        m->made = ticks();
        m->queued = 1;
        if (order_count < MEMORIES) order[order_count++] = m - memories;
        pthread_cond_broadcast(&arrived);
        return;
    }
}

static void *run(void *unused)
{
    (void)unused;
    for (;;) {
        pthread_mutex_lock(&lock);
        double wait_s = !trigger ? 1.0 / fps : trigger_hz ? 1.0 / trigger_hz : 0.01;
        if (trigger && shortest_s() + exposure_ms * 1e-3 > wait_s)
            wait_s *= (int)((shortest_s() + exposure_ms * 1e-3) / wait_s) + 1;
        int on = alive;
        pthread_mutex_unlock(&lock);
        if (!on) return NULL;
        usleep((useconds_t)(wait_s * 1e6));
        pthread_mutex_lock(&lock);
        if (alive && live && plugged && !frozen && trigger_hz) make_frame();
        pthread_mutex_unlock(&lock);
    }
}

#define BEGIN(handle) pthread_mutex_lock(&lock); int code = ready(handle); if (code == SUCCESS) {
#define END } pthread_mutex_unlock(&lock); return code;

int is_GetNumberOfCameras(int *count) { *count = plugged; return SUCCESS; }

int is_GetCameraList(CameraList *list)
{
    if (list->count < 1) return INVALID_PARAMETER;
    list->count = plugged;
    if (!plugged) return SUCCESS;
    memset(list->cameras, 0, sizeof list->cameras);
    list->cameras[0].camera = 1;
    list->cameras[0].device = 7;
    list->cameras[0].in_use = opened;
    strcpy(list->cameras[0].serial, "4103123456");
    strcpy(list->cameras[0].model, "UI325xCP-C");
    strcpy(list->cameras[0].full, "UI-3250CP-C-HQ");
    return SUCCESS;
}

int is_InitCamera(unsigned *handle, void *window)
{
    (void)window;
    pthread_mutex_lock(&lock);
    int code = !plugged || *handle != (7 | 0x8000) ? CANT_OPEN : opened ? IN_USE : SUCCESS;
    if (code == SUCCESS) {
        for (int k = 0; k < MEMORIES; k++) { free(memories[k].data); memset(&memories[k], 0, sizeof memories[k]); }
        opened = 1, opens++, *handle = 1, live = frozen = 0, queue_ready = 0, order_count = 0;
        clock_mhz = 30, exposure_ms = 10, fps = 10, delay_us = 0, trigger = 0, shutter = 2, bits = 8;
        area = (Rect){0, 0, 1600, 1200};
        alive = 1;
        pthread_create(&thread, NULL, run, NULL);
    }
    pthread_mutex_unlock(&lock);
    return code;
}

int is_ExitCamera(unsigned handle)
{
    pthread_mutex_lock(&lock);
    int ok = opened && handle == 1;
    if (ok) alive = live = opened = 0;
    pthread_mutex_unlock(&lock);
    if (!ok) return INVALID_HANDLE;
    pthread_join(thread, NULL);
    for (int k = 0; k < MEMORIES; k++) { free(memories[k].data); memset(&memories[k], 0, sizeof memories[k]); }
    return SUCCESS;
}

int is_GetSensorInfo(unsigned handle, SensorInfo *info)
{
    BEGIN(handle)
    memset(info, 0, sizeof *info);
    info->mode = mosaic ? 2 : 1, info->width = 1600, info->height = 1200, info->bayer = 1;
    END
}

int is_SetColorMode(unsigned handle, int mode)
{
    BEGIN(handle)
    if (mode == 0x8000) code = bits == 12 ? (mosaic ? 27 : 26) : (mosaic ? 11 : 6);
    else if (live) code = CAPTURE_RUNNING;
    else if (mode == (mosaic ? 27 : 26)) bits = 12;
    else if (mode == (mosaic ? 11 : 6)) bits = 8;
    else code = mode == 33 || mode == 34 ? NOT_SUPPORTED : INVALID_PARAMETER;
    END
}

int is_DeviceFeature(unsigned handle, unsigned command, uint32_t *value, unsigned size)
{
    BEGIN(handle)
    if (size != 4) code = BAD_SIZE;
    else if (command == 1) *value = 3;
    else if (command == 6) { if (live) code = CAPTURE_RUNNING; else if (*value == 1 || *value == 2) shutter = *value; else code = fault("shutter mode"); }
    else if (command == 7) *value = shutter;
    else code = NOT_SUPPORTED;
    END
}

int is_SetExternalTrigger(unsigned handle, int mode)
{
    BEGIN(handle)
    if (live) code = CAPTURE_RUNNING;
    else if (mode == 0 || mode == 0x1001 || mode == 0x1002) trigger = mode;
    else code = fault("trigger mode");
    END
}

int is_SetTriggerDelay(unsigned handle, int delay)
{
    BEGIN(handle)
    if (delay == 0x8000) code = delay_us;
    else if (delay == 0x8001) code = 15;
    else if (delay == 0x8002) code = 4000000;
    else if (delay == 0x8003) code = 1;
    else if (delay != 0 && (delay < 15 || delay > 4000000)) code = fault("trigger delay");
    else if (!trigger) code = fault("trigger delay without a trigger");
    else delay_us = delay;
    END
}

int is_PixelClock(unsigned handle, unsigned command, uint32_t *value, unsigned size)
{
    BEGIN(handle)
    int count = 0;
    for (int mhz = 1; mhz <= 128; mhz++) count += clock_allowed(mhz);
    if (command == 1 && size == 4) *value = count;
    else if (command == 2 && size == 4u * count) { for (int mhz = 1; mhz <= 128; mhz++) if (clock_allowed(mhz)) *value++ = mhz; }
    else if (command == 5 && size == 4) *value = clock_mhz;
    else if (command == 6 && size == 4) {
        if (!clock_allowed(*value)) code = fault("pixel clock");
        else {
            if (live) { frozen = 1; fault("pixel clock while live"); }
            clock_mhz = *value; /* it changes all that comes after it */
            fps = 0.5 / shortest_s();
            round_exposure(1000.0 / fps);
        }
    } else code = command == 1 || command == 2 || command == 5 || command == 6 ? BAD_SIZE : NOT_SUPPORTED;
    END
}

int is_GetFrameTimeRange(unsigned handle, double *low, double *high, double *step)
{
    BEGIN(handle)
    *low = shortest_s(), *high = 2.0, *step = line_us() * 1e-6;
    END
}

int is_SetFrameRate(unsigned handle, double wanted, double *got)
{
    BEGIN(handle)
    if (!(wanted > 0)) code = fault("frame rate");
    else {
        fps = wanted > 1.0 / shortest_s() ? 1.0 / shortest_s() : wanted < 0.5 ? 0.5 : wanted;
        *got = fps;
        if (exposure_ms > longest_ms()) round_exposure(longest_ms());
    }
    END
}

int is_Exposure(unsigned handle, unsigned command, double *value, unsigned size)
{
    BEGIN(handle)
    if (command == 6 && size == 24) value[0] = line_us() * 1e-3, value[1] = longest_ms(), value[2] = line_us() * 1e-3;
    else if (command == 7 && size == 8) *value = exposure_ms;
    else if (command == 12 && size == 8) {
        if (!(*value >= line_us() * 1e-3 - 1e-9 && *value <= longest_ms() + 1e-9)) code = fault("exposure");
        else { if (live) { frozen = 1; fault("exposure while live"); } round_exposure(*value); *value = exposure_ms; }
    } else code = command == 6 || command == 7 || command == 12 ? BAD_SIZE : NOT_SUPPORTED;
    END
}

int is_AOI(unsigned handle, unsigned command, Rect *rect, unsigned size)
{
    BEGIN(handle)
    if (command == 1 && size == 16) {
        int bad = rect->x < 0 || rect->y < 0 || rect->w < 16 || rect->h < 4 || rect->x + rect->w > 1600 ||
                  rect->y + rect->h > 1200 || rect->w % 4 || rect->h % 2 || rect->x % 2 || rect->y % 2;
        if (bad) code = fault("region of interest");
        else { if (live) { frozen = 1; fault("region of interest while live"); } area = *rect; fps = 0.5 / shortest_s(); }
    }
    else if (command == 2 && size == 16) *rect = area;
    else if (command == 8 && size == 8) rect->x = 16, rect->y = 4;
    else if (command == 0x11 && size == 8) rect->x = 2, rect->y = 2;
    else if (command == 0x12 && size == 8) rect->x = 4, rect->y = 2;
    else code = INVALID_PARAMETER;
    END
}

static int held(void) { int n = 0; for (int k = 0; k < MEMORIES; k++) n += memories[k].data != NULL; return n; }

int is_AllocImageMem(unsigned handle, int width, int height, int depth, char **address, int *number)
{
    BEGIN(handle)
    if (width != area.w || height != area.h || depth != (bits > 8 ? 16 : 8)) code = fault("memory of another size");
    else {
        int k = 0;
        while (k < MEMORIES && memories[k].data) k++;
        if (k == MEMORIES) code = 127;
        else {
            int pitch = (width * depth / 8 + 63) / 64 * 64; /* rows are padded */
            memories[k] = (Memory){calloc(height, pitch), width, height, depth, pitch, 0, 0, 0, 0, 0};
            *address = (char *)memories[k].data;
            *number = k + 1;
            if (held() > most_memories) most_memories = held();
        }
    }
    END
}

static Memory *find(int number, const char *address)
{
    Memory *m = number >= 1 && number <= MEMORIES ? &memories[number - 1] : NULL;
    return m && m->data && (const char *)m->data == address ? m : NULL;
}

int is_InquireImageMem(unsigned handle, char *address, int number, int *x, int *y, int *depth, int *pitch)
{
    BEGIN(handle)
    Memory *m = find(number, address);
    if (!m) code = INVALID_PARAMETER; else *x = m->width, *y = m->height, *depth = m->bits, *pitch = m->pitch;
    END
}

int is_FreeImageMem(unsigned handle, char *address, int number)
{
    BEGIN(handle)
    Memory *m = find(number, address);
    if (!m) code = INVALID_PARAMETER;
    else if (live) code = fault("memory freed while live");
    else { free(m->data); memset(m, 0, sizeof *m); }
    END
}

int is_AddToSequence(unsigned handle, char *address, int number)
{
    BEGIN(handle)
    Memory *m = find(number, address);
    if (!m) code = INVALID_PARAMETER; else m->listed = 1;
    END
}

int is_ClearSequence(unsigned handle)
{
    BEGIN(handle)
    for (int k = 0; k < MEMORIES; k++) memories[k].listed = memories[k].queued = memories[k].locked = 0;
    END
}

int is_CaptureVideo(unsigned handle, int wait)
{
    BEGIN(handle)
    int listed = 0;
    for (int k = 0; k < MEMORIES; k++) listed += memories[k].listed;
    if (live) code = CAPTURE_RUNNING;
    else if (!listed || !queue_ready || wait != 0) code = fault("capture without memory, queue or wait");
    else live = 1;
    END
}

int is_StopLiveVideo(unsigned handle, int wait)
{
    BEGIN(handle)
    (void)wait;
    live = 0;
    END
}

static int wait_for_image(WaitBuffer *wait)
{
    struct timespec end;
    clock_gettime(CLOCK_REALTIME, &end);
    end.tv_nsec += (wait->timeout_ms % 1000) * 1000000L;
    end.tv_sec += wait->timeout_ms / 1000 + end.tv_nsec / 1000000000L;
    end.tv_nsec %= 1000000000L;
    while (plugged && live && !order_count && pthread_cond_timedwait(&arrived, &lock, &end) != ETIMEDOUT) {}
    if (!plugged) return IO_FAILED;
    if (!order_count) return TIMED_OUT;
    Memory *m = &memories[order[0]];
    memmove(order, order + 1, --order_count * sizeof order[0]);
    m->queued = 0, m->locked = 1;
    *wait->address = (char *)m->data, *wait->number = m - memories + 1;
    return SUCCESS;
}

int is_ImageQueue(unsigned handle, unsigned command, void *parameter, unsigned size)
{
    BEGIN(handle)
    if (command == 0 && !parameter) { if (live) code = CAPTURE_RUNNING; else queue_ready = 1, order_count = 0; }
    else if (command == 1 && !parameter) { if (!queue_ready) code = INVALID_PARAMETER; else queue_ready = 0, order_count = 0; }
    else if (command == 2 && size == sizeof(WaitBuffer)) code = wait_for_image(parameter);
    else if (command == 4 && size == 4) *(uint32_t *)parameter = order_count;
    else code = INVALID_PARAMETER;
    END
}

int is_GetImageInfo(unsigned handle, int number, ImageInfo *info, int size)
{
    BEGIN(handle)
    if (size != (int)sizeof *info) code = BAD_SIZE;
    else if (number < 1 || number > MEMORIES || !memories[number - 1].locked) code = INVALID_PARAMETER;
    else { memset(info, 0, sizeof *info); info->frame = memories[number - 1].frame; info->device_time = memories[number - 1].made; info->width = area.w; info->height = area.h; }
    END
}

int is_UnlockSeqBuf(unsigned handle, int number, char *address)
{
    BEGIN(handle)
    Memory *m = find(number, address);
    if (!m || !m->locked) code = INVALID_PARAMETER; else m->locked = 0;
    END
}

void stub_plug(int in)
{
    pthread_mutex_lock(&lock);
    int ran = !in && alive;
    plugged = in;
    if (!in) opened = live = alive = 0;
    pthread_cond_broadcast(&arrived);
    pthread_mutex_unlock(&lock);
    if (ran) pthread_join(thread, NULL);
}

void stub_trigger_hz(int hz) { trigger_hz = hz; }
void stub_mosaic(int on) { mosaic = on; }
int stub_faults(char *text, int size) { snprintf(text, size, "%s", complaint); int n = faults; faults = 0; complaint[0] = 0; return n; }
int stub_memories(void) { return held(); }
int stub_opens(void) { return opens; }
int stub_trigger_mode(void) { return trigger; }
int stub_frames(void) { return (int)frame; }
void stub_occupy(int on) { opened = on; }
