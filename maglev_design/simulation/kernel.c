/* Closed loops in vector lanes, from t = 0 to the horizon.
 *
 * A generated file goes before this one: LANES, the sizes N_STATE, N_PARAMETER, N_INPUT, PIECES
 * (integration steps a period), NODES (reference nodes a step), DIRECTIONS, and the functions
 * step(), measure() and measure_crossing(). Every array has the lane as its last index.
 *
 * The order of the additions is that of the arguments; nothing here depends on how many loops run
 * in one call or on how the call was split.
 */

#define WIDTH (1 + DIRECTIONS)
enum { PART_START, PART_MOVE, PART_HOLD, PARTS };

static inline real spread(double x) { return ZERO + x; }

static inline pair joined(word first, word second)
{
    pair both;
    memcpy(&both, &first, sizeof first);
    memcpy((word *)&both + 1, &second, sizeof second);
    return both;
}

/* pcg4d and the sum of its sixteen-bit halves: the noise stream of noise.py, bit for bit; both
 * channels of one sample at once. */
static inline void standard_normals(pair seed, pair index, uint32_t counter, real *normal)
{
    pair v0 = seed * 1664525u + 1013904223u;
    pair v1 = index * 1664525u + 1013904223u;
    pair v2 = joined(WORD_ZERO, WORD_ZERO + 1u) * 1664525u + 1013904223u;
    pair v3 = ((pair){0} + counter) * 1664525u + 1013904223u;
    for (int turn = 0; turn < 2; turn++) {
        v0 = v0 + v1 * v3;
        v1 = v1 + v2 * v0;
        v2 = v2 + v0 * v1;
        v3 = v3 + v1 * v2;
        if (turn == 0) {
            v0 ^= v0 >> 16;
            v1 ^= v1 >> 16;
            v2 ^= v2 >> 16;
            v3 ^= v3 >> 16;
        }
    }
    const pair total = (v0 & 0xFFFFu) + (v0 >> 16) + (v1 & 0xFFFFu) + (v1 >> 16)
                     + (v2 & 0xFFFFu) + (v2 >> 16) + (v3 & 0xFFFFu) + (v3 >> 16);
    for (int channel = 0; channel < 2; channel++) {
        word own;
        memcpy(&own, (const word *)&total + channel, sizeof own);
        const real r = (to_real(own) - 4.0 * 65535.0) * 1.8688123647942946e-05;
        const real r2 = r * r;
        normal[channel] = r * (0.981000583 + r2 * (0.00598929986
                        + r2 * (7.27466071e-05 + r2 * 1.11261435e-05)));
    }
}

/* One block of LANES loops. The arguments are those of run(), for this block. */
static void run_block(
    int64_t steps, const double *restrict inputs, const double *restrict starts,
    const uint8_t *restrict parts, const double *restrict given, const double *restrict first,
    const uint32_t *restrict words, const double *restrict spreads, int noisy,
    anywhere *restrict figures, anywhere *restrict trace)
{
    real parameters[N_PARAMETER * WIDTH], deviation[2];
    word stream[2];
    real state[N_STATE * WIDTH], following[N_STATE * WIDTH], noise[2] = {ZERO, ZERO};
    real voltages[2 * WIDTH], track[2 * PIECES * WIDTH], error[WIDTH], slope[WIDTH];
    real sums[PARTS * 3], slopes[3 * WIDTH], added[3 * WIDTH], extremes[6 * WIDTH];
    real variation = ZERO, previous = ZERO, survived = ZERO;
    memcpy(parameters, given, sizeof parameters);
    memcpy(state, first, sizeof state);
    memcpy(stream, words, sizeof stream);
    memcpy(deviation, spreads, sizeof deviation);
    const pair seed = joined(stream[0], stream[0]), index = joined(stream[1], stream[1]);
    for (int k = 0; k < PARTS * 3; k++) sums[k] = ZERO;
    for (int k = 0; k < 3 * WIDTH; k++) slopes[k] = ZERO;
    for (int d = 0; d < WIDTH; d++) {
        error[d] = state[d * N_STATE] - (d ? ZERO : spread(inputs[PIECES]));
        slope[d] = state[d * N_STATE + 1] - (d ? ZERO : spread(inputs[PIECES + NODES]));
        extremes[0 * WIDTH + d] = d ? ZERO : spread(-LARGE); /* commanded, largest */
        extremes[1 * WIDTH + d] = d ? ZERO : spread(LARGE);  /* commanded, smallest */
        extremes[2 * WIDTH + d] = d ? ZERO : spread(-LARGE); /* applied, largest */
        extremes[3 * WIDTH + d] = state[d * N_STATE];        /* gap, smallest */
        extremes[4 * WIDTH + d] = state[d * N_STATE];        /* gap, largest */
    }
    for (int64_t n = 0; n < steps; n++) {
        const double *row = inputs + n * N_INPUT;
        if (noisy) {
            standard_normals(seed, index, (uint32_t)n, noise);
            noise[0] *= deviation[0];
            noise[1] *= deviation[1];
        }
        const real alive = state[ALIVE];
        step(state, parameters, row, noise, following, voltages, track);
        survived += alive;
        keep_larger(extremes + 0 * WIDTH, voltages, 2, alive);
        keep_smaller(extremes + 1 * WIDTH, voltages, 2, alive);
        keep_larger(extremes + 2 * WIDTH, voltages + 1, 2, alive);
        if (n) variation += absolute(voltages[1] - previous);
        previous = voltages[1];
        for (int piece = 0; piece < PIECES; piece++) {
            const int node = (piece + 1) * NODES_A_PIECE;
            const real ends[2] = {spread(row[PIECES + node]), spread(row[PIECES + NODES + node])};
            real now[WIDTH], rate[WIDTH];
            for (int d = 0; d < WIDTH; d++) {
                const real *tracked = track + d * 2 * PIECES;
                now[d] = tracked[piece] - (d ? ZERO : ends[0]);
                rate[d] = tracked[PIECES + piece] - (d ? ZERO : ends[1]);
            }
            const double length = row[piece], start = starts[n * PIECES + piece];
            if (any(error[0] * now[0] < 0.0))
                measure_crossing(error, now, slope, rate, start, length, added);
            else
                measure(error, now, slope, rate, start, length, added);
            real *sum = sums + 3 * parts[n * PIECES + piece];
            for (int k = 0; k < 3; k++) sum[k] += added[k];
            for (int k = 3; k < 3 * WIDTH; k++) slopes[k] += added[k];
            for (int d = 0; d < WIDTH; d++) { error[d] = now[d]; slope[d] = rate[d]; }
        }
        for (int k = 0; k < N_STATE * WIDTH; k++) state[k] = following[k];
        keep_smaller(extremes + 3 * WIDTH, state, N_STATE, spread(1.0));
        keep_larger(extremes + 4 * WIDTH, state, N_STATE, spread(1.0));
        if (trace) {
            trace[4 * n] = state[0];
            trace[4 * n + 1] = state[1];
            trace[4 * n + 2] = voltages[0];
            trace[4 * n + 3] = voltages[1];
        }
    }
    survived += state[ALIVE];
    for (int k = 0; k < PARTS * 3; k++) figures[k] = sums[k];
    figures += PARTS * 3;
    for (int k = 0; k < 5; k++) figures[k] = extremes[k * WIDTH];
    figures[5] = variation;
    figures[6] = error[0];
    figures[7] = survived;
    figures[8] = state[0];
    figures += 9;
    for (int d = 0; d < DIRECTIONS; d++, figures += 8) {
        for (int k = 0; k < 3; k++) figures[k] = slopes[3 * (1 + d) + k];
        for (int k = 0; k < 5; k++) figures[3 + k] = extremes[k * WIDTH + 1 + d];
    }
}

/* `blocks` blocks of LANES loops; figures has N_FIGURES values a lane, trace 4 a step or is null. */
void run(
    int64_t blocks, int64_t steps, const double *inputs, const double *starts,
    const uint8_t *parts, const double *parameters, const double *first, const uint32_t *stream,
    const double *deviation, int noisy, double *figures, double *trace)
{
    for (int64_t b = 0; b < blocks; b++)
        run_block(
            steps, inputs, starts, parts,
            parameters + b * N_PARAMETER * WIDTH * LANES, first + b * N_STATE * WIDTH * LANES,
            stream + b * 2 * LANES, deviation + b * 2 * LANES, noisy,
            (anywhere *)(figures + b * N_FIGURES * LANES),
            trace ? (anywhere *)(trace + b * 4 * steps * LANES) : 0);
}
