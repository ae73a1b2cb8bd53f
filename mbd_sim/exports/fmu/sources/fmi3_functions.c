/*
 * The Functional Mock-up Interface, version 3.0 (https://fmi-standard.org), of a mechanism: co-simulation and model
 * exchange. The mechanism itself is in the module that fmi3_model.h includes.
 *
 * SPDX-License-Identifier: Apache-2.0
 */
#ifdef FMI3_HEADER
#include FMI3_HEADER
#else
#include "fmi3_types.h"
#endif
#include "fmi3_model.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#if defined(__GNUC__)
#define EXPORT __attribute__((visibility("default")))
#elif defined(_WIN32)
#define EXPORT __declspec(dllexport)
#else
#define EXPORT
#endif

/* Value references: the time, then states, inputs, parameters, outputs, and the derivatives of the states. */
enum {
    FIRST_STATE = 1,
    FIRST_INPUT = FIRST_STATE + MODEL_STATES,
    FIRST_PARAMETER = FIRST_INPUT + MODEL_INPUTS,
    FIRST_OUTPUT = FIRST_PARAMETER + MODEL_PARAMETERS,
    FIRST_DERIVATIVE = FIRST_OUTPUT + MODEL_OUTPUTS,
    BEYOND = FIRST_DERIVATIVE + MODEL_STATES
};

#define TIME_TOLERANCE 1e-9 /* of a step: by how much communication points may differ from multiples of it */
#define DRIFT 1e-9          /* of a state, relative to 1 + |y|: beyond, it is moved back to the constraints */
#define LARGEST_GAP 1e-6    /* the change of a state that may remain where loops are closed */
#define SWEEPS 30           /* of Newton's method, in which loops are closed */

typedef enum { INSTANTIATED, INITIALIZATION, STEP, EVENT, CONTINUOUS_TIME, TERMINATED } phase;

/* Everything that an FMU state contains. */
typedef struct {
    model_state state;
    model_inputs inputs;
    model_parameters parameters;
    model_history history; /* of methods that use earlier steps */
    double time, origin; /* s; step k of the index begins at origin + k * MODEL_STEP */
    int64_t index;
    unsigned char given[MODEL_STATES + MODEL_INPUTS]; /* whether a state or an input was set to another value */
    int changed; /* whether start values have to follow: those of the file at the time 0 do not */
    phase phase;
} snapshot;

typedef struct {
    snapshot now;
    int model_exchange;
    fmi3InstanceEnvironment environment;
    fmi3LogMessageCallback log;
} unit;

static fmi3Status fail(const unit *self, const char *message)
{
    if (self->log)
        self->log(self->environment, fmi3Error, "errors", message);
    return fmi3Error;
}

/* The structures of the model are arrays of doubles. */
static double field(const void *structure, size_t index)
{
    double value;

    memcpy(&value, (const char *)structure + index * sizeof value, sizeof value);
    return value;
}

static void set_field(void *structure, size_t index, double value)
{
    memcpy((char *)structure + index * sizeof value, &value, sizeof value);
}

static void start(unit *self)
{
    memset(&self->now, 0, sizeof self->now);
    model_start(&self->now.state, &self->now.inputs, &self->now.parameters);
    self->now.phase = INSTANTIATED;
}

static unit *instantiate(
    fmi3String token, int model_exchange, fmi3InstanceEnvironment environment, fmi3LogMessageCallback log)
{
    unit *self;
    unit before = {.environment = environment, .log = log};

#ifdef MODEL_NEEDS_FMA
    if (!__builtin_cpu_supports("fma") || !__builtin_cpu_supports("avx2")) {
        fail(&before, "this processor has no fused multiply-adds. Compile the sources of this unit on it.");
        return NULL;
    }
#endif
    if (!token || strcmp(token, MODEL_TOKEN)) {
        fail(&before, "the instantiation token is not that of this unit: modelDescription.xml is of another one.");
        return NULL;
    }
    self = malloc(sizeof *self);
    if (!self) {
        fail(&before, "out of memory.");
        return NULL;
    }
    self->model_exchange = model_exchange;
    self->environment = environment;
    self->log = log;
    start(self);
    return self;
}

/* Move a state back to the constraints; returns the largest change, relative to 1 + |y|. */
static double projected(snapshot *now)
{
    model_state before = now->state;
    double largest = 0.0;
    size_t i;

    model_project(now->time, &now->state, &now->inputs, &now->parameters);
    for (i = 0; i < MODEL_STATES; i++) {
        double old = field(&before, i), change = fabs(field(&now->state, i) - old) / (1.0 + fabs(old));
        if (!(change <= largest))
            largest = change;
    }
    return largest;
}

/* Let start values follow from parameters, and from those that are given. */
static fmi3Status settle(unit *self)
{
    snapshot *now = &self->now;
    double change = 0.0;
    int sweep;

    if (!now->changed)
        return fmi3OK;
#if MODEL_ASSEMBLES
    (void)sweep, (void)change;
    switch (model_assemble(now->time, &now->state, &now->inputs, &now->parameters, now->given)) {
    case 0:
        return fail(self, "the loops do not close near these start values: set states nearer to a closed position.");
    case -1:
        return fail(self, "the constraints do not allow these speeds at the start: set others, or fewer.");
    case -2:
        return fail(self, model_unknown_start(&now->parameters, now->given));
    }
#else
    for (sweep = 0; MODEL_PROJECTS && sweep < SWEEPS; sweep++)
        change = projected(now);
    if (!(change <= LARGEST_GAP))
        return fail(self, "a quaternion at the start is zero: set another one.");
#endif
    now->changed = 0;
    return fmi3OK;
}

EXPORT const char *fmi3GetVersion(void)
{
    return "3.0";
}

EXPORT fmi3Status fmi3SetDebugLogging(
    fmi3Instance instance, fmi3Boolean on, size_t count, const fmi3String categories[])
{
    (void)instance, (void)on, (void)count, (void)categories; /* there are only errors, which are always reported */
    return fmi3OK;
}

EXPORT fmi3Instance fmi3InstantiateModelExchange(
    fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible, fmi3Boolean logging,
    fmi3InstanceEnvironment environment, fmi3LogMessageCallback log)
{
    (void)name, (void)resources, (void)visible, (void)logging;
    if (MODEL_SAMPLED) {
        unit before = {.environment = environment, .log = log};
        fail(&before, "sampled controllers and delays act between fixed steps: use co-simulation.");
        return NULL;
    }
    return instantiate(token, 1, environment, log);
}

EXPORT fmi3Instance fmi3InstantiateCoSimulation(
    fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible, fmi3Boolean logging,
    fmi3Boolean event_mode, fmi3Boolean early_return, const fmi3ValueReference intermediate[], size_t intermediates,
    fmi3InstanceEnvironment environment, fmi3LogMessageCallback log, fmi3IntermediateUpdateCallback update)
{
    unit before = {.environment = environment, .log = log};

    (void)name, (void)resources, (void)visible, (void)logging, (void)early_return, (void)intermediate;
    (void)intermediates, (void)update;
    if (event_mode) {
        fail(&before, "this unit has no event mode in co-simulation.");
        return NULL;
    }
    return instantiate(token, 0, environment, log);
}

EXPORT fmi3Instance fmi3InstantiateScheduledExecution(
    fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible, fmi3Boolean logging,
    fmi3InstanceEnvironment environment, fmi3LogMessageCallback log, fmi3ClockUpdateCallback update,
    fmi3LockPreemptionCallback lock, fmi3UnlockPreemptionCallback unlock)
{
    unit before = {.environment = environment, .log = log};

    (void)name, (void)token, (void)resources, (void)visible, (void)logging, (void)update, (void)lock, (void)unlock;
    fail(&before, "scheduled execution is not supported: use co-simulation or model exchange.");
    return NULL;
}

EXPORT void fmi3FreeInstance(fmi3Instance instance)
{
    free(instance);
}

EXPORT fmi3Status fmi3EnterInitializationMode(
    fmi3Instance instance, fmi3Boolean tolerance_defined, fmi3Float64 tolerance, fmi3Float64 start_time,
    fmi3Boolean stop_defined, fmi3Float64 stop_time)
{
    unit *self = instance;

    (void)tolerance_defined, (void)tolerance, (void)stop_defined, (void)stop_time;
    if (self->now.phase != INSTANTIATED)
        return fail(self, "initialization begins only once after instantiation or a reset.");
    self->now.time = self->now.origin = start_time;
    self->now.changed |= start_time != 0.0;
    self->now.phase = INITIALIZATION;
    return fmi3OK;
}

EXPORT fmi3Status fmi3ExitInitializationMode(fmi3Instance instance)
{
    unit *self = instance;

    if (self->now.phase != INITIALIZATION)
        return fail(self, "there is no initialization to end.");
    if (settle(self) != fmi3OK)
        return fmi3Error;
    self->now.phase = self->model_exchange ? EVENT : STEP;
    return fmi3OK;
}

EXPORT fmi3Status fmi3EnterEventMode(fmi3Instance instance)
{
    unit *self = instance;

    if (self->now.phase != CONTINUOUS_TIME)
        return fail(self, "event mode is entered only from continuous-time mode, in model exchange.");
    self->now.phase = EVENT;
    return fmi3OK;
}

EXPORT fmi3Status fmi3Terminate(fmi3Instance instance)
{
    ((unit *)instance)->now.phase = TERMINATED;
    return fmi3OK;
}

EXPORT fmi3Status fmi3Reset(fmi3Instance instance)
{
    start(instance);
    return fmi3OK;
}

EXPORT fmi3Status fmi3GetFloat64(
    fmi3Instance instance, const fmi3ValueReference references[], size_t count, fmi3Float64 values[], size_t sizes)
{
    unit *self = instance;
    const snapshot *now = &self->now;
    model_outputs outputs;
    model_state rates;
    int has_outputs = 0, has_rates = 0;
    size_t i;

    if (count != sizes)
        return fail(self, "all variables are scalars: give one value for each reference.");
    if (now->phase == INITIALIZATION && settle(self) != fmi3OK)
        return fmi3Error;
    for (i = 0; i < count; i++) {
        fmi3ValueReference at = references[i];
        if (at >= BEYOND)
            return fail(self, "there is no variable of this value reference.");
        if (at >= FIRST_OUTPUT && at < FIRST_DERIVATIVE && !has_outputs++)
            model_output(now->time, &now->state, &now->inputs, &now->parameters, &outputs);
        if (at >= FIRST_DERIVATIVE && !has_rates++)
            model_rates(now->time, &now->state, &now->inputs, &now->parameters, &rates);
        values[i] = at >= FIRST_DERIVATIVE  ? field(&rates, at - FIRST_DERIVATIVE)
                    : at >= FIRST_OUTPUT    ? field(&outputs, at - FIRST_OUTPUT)
                    : at >= FIRST_PARAMETER ? field(&now->parameters, at - FIRST_PARAMETER)
                    : at >= FIRST_INPUT     ? field(&now->inputs, at - FIRST_INPUT)
                    : at >= FIRST_STATE     ? field(&now->state, at - FIRST_STATE)
                                            : now->time;
    }
    return fmi3OK;
}

EXPORT fmi3Status fmi3SetFloat64(
    fmi3Instance instance, const fmi3ValueReference references[], size_t count, const fmi3Float64 values[],
    size_t sizes)
{
    unit *self = instance;
    snapshot *now = &self->now;
    size_t i;

    if (count != sizes)
        return fail(self, "all variables are scalars: give one value for each reference.");
    for (i = 0; i < count; i++) {
        fmi3ValueReference at = references[i];
        if (!isfinite(values[i]))
            return fail(self, "a value is not a finite number.");
        if (at < FIRST_STATE || at >= FIRST_OUTPUT)
            return fail(self, "the time, outputs and derivatives cannot be set.");
        if (at < FIRST_INPUT && now->phase != INSTANTIATED && now->phase != INITIALIZATION)
            return fail(self, "states are set before the end of the initialization.");
    }
    for (i = 0; i < count; i++) {
        fmi3ValueReference at = references[i];
        if (at >= FIRST_INPUT && at < FIRST_PARAMETER) {
            now->given[at - FIRST_STATE] |= field(&now->inputs, at - FIRST_INPUT) != values[i];
            set_field(&now->inputs, at - FIRST_INPUT, values[i]);
        } else if (at >= FIRST_PARAMETER && field(&now->parameters, at - FIRST_PARAMETER) != values[i])
            set_field(&now->parameters, at - FIRST_PARAMETER, values[i]), now->changed = 1;
        else if (at < FIRST_INPUT && field(&now->state, at - FIRST_STATE) != values[i])
            set_field(&now->state, at - FIRST_STATE, values[i]), now->given[at - FIRST_STATE] = now->changed = 1;
    }
    return fmi3OK;
}

/* There are variables of no other type. */
#define NO_VARIABLES(TYPE)                                                                                           \
    EXPORT fmi3Status fmi3Get##TYPE(                                                                                 \
        fmi3Instance instance, const fmi3ValueReference references[], size_t count, fmi3##TYPE values[], size_t sizes) \
    {                                                                                                                \
        (void)references, (void)values, (void)sizes;                                                                 \
        return count ? fail(instance, "all variables are of the type Float64.") : fmi3OK;                            \
    }                                                                                                                \
    EXPORT fmi3Status fmi3Set##TYPE(                                                                                 \
        fmi3Instance instance, const fmi3ValueReference references[], size_t count, const fmi3##TYPE values[],       \
        size_t sizes)                                                                                                \
    {                                                                                                                \
        (void)references, (void)values, (void)sizes;                                                                 \
        return count ? fail(instance, "all variables are of the type Float64.") : fmi3OK;                            \
    }

NO_VARIABLES(Float32)
NO_VARIABLES(Int8)
NO_VARIABLES(UInt8)
NO_VARIABLES(Int16)
NO_VARIABLES(UInt16)
NO_VARIABLES(Int32)
NO_VARIABLES(UInt32)
NO_VARIABLES(Int64)
NO_VARIABLES(UInt64)
NO_VARIABLES(Boolean)
NO_VARIABLES(String)

EXPORT fmi3Status fmi3GetBinary(
    fmi3Instance instance, const fmi3ValueReference references[], size_t count, size_t value_sizes[],
    fmi3Binary values[], size_t sizes)
{
    (void)references, (void)value_sizes, (void)values, (void)sizes;
    return count ? fail(instance, "all variables are of the type Float64.") : fmi3OK;
}

EXPORT fmi3Status fmi3SetBinary(
    fmi3Instance instance, const fmi3ValueReference references[], size_t count, const size_t value_sizes[],
    const fmi3Binary values[], size_t sizes)
{
    (void)references, (void)value_sizes, (void)values, (void)sizes;
    return count ? fail(instance, "all variables are of the type Float64.") : fmi3OK;
}

EXPORT fmi3Status fmi3GetClock(
    fmi3Instance instance, const fmi3ValueReference references[], size_t count, fmi3Clock values[])
{
    (void)references, (void)values;
    return count ? fail(instance, "all variables are of the type Float64.") : fmi3OK;
}

EXPORT fmi3Status fmi3SetClock(
    fmi3Instance instance, const fmi3ValueReference references[], size_t count, const fmi3Clock values[])
{
    (void)references, (void)values;
    return count ? fail(instance, "all variables are of the type Float64.") : fmi3OK;
}

EXPORT fmi3Status fmi3GetNumberOfVariableDependencies(
    fmi3Instance instance, fmi3ValueReference reference, size_t *count)
{
    (void)reference, (void)count;
    return fail(instance, "dependencies of variables are not provided.");
}

EXPORT fmi3Status fmi3GetVariableDependencies(
    fmi3Instance instance, fmi3ValueReference dependent, size_t elements[], fmi3ValueReference independents[],
    size_t independent_elements[], fmi3DependencyKind kinds[], size_t count)
{
    (void)dependent, (void)elements, (void)independents, (void)independent_elements, (void)kinds, (void)count;
    return fail(instance, "dependencies of variables are not provided.");
}

EXPORT fmi3Status fmi3GetFMUState(fmi3Instance instance, fmi3FMUState *state)
{
    unit *self = instance;

    if (!*state)
        *state = malloc(sizeof(snapshot));
    if (!*state)
        return fail(self, "out of memory.");
    memcpy(*state, &self->now, sizeof(snapshot));
    return fmi3OK;
}

EXPORT fmi3Status fmi3SetFMUState(fmi3Instance instance, fmi3FMUState state)
{
    memcpy(&((unit *)instance)->now, state, sizeof(snapshot));
    return fmi3OK;
}

EXPORT fmi3Status fmi3FreeFMUState(fmi3Instance instance, fmi3FMUState *state)
{
    (void)instance;
    free(*state);
    *state = NULL;
    return fmi3OK;
}

EXPORT fmi3Status fmi3SerializedFMUStateSize(fmi3Instance instance, fmi3FMUState state, size_t *size)
{
    (void)instance, (void)state;
    *size = sizeof(snapshot);
    return fmi3OK;
}

EXPORT fmi3Status fmi3SerializeFMUState(fmi3Instance instance, fmi3FMUState state, fmi3Byte bytes[], size_t size)
{
    if (size < sizeof(snapshot))
        return fail(instance, "the memory is too small for the state: ask for its size.");
    memcpy(bytes, state, sizeof(snapshot));
    return fmi3OK;
}

EXPORT fmi3Status fmi3DeserializeFMUState(
    fmi3Instance instance, const fmi3Byte bytes[], size_t size, fmi3FMUState *state)
{
    if (size != sizeof(snapshot))
        return fail(instance, "these bytes are not a state of this unit.");
    if (!*state)
        *state = malloc(sizeof(snapshot));
    if (!*state)
        return fail(instance, "out of memory.");
    memcpy(*state, bytes, sizeof(snapshot));
    return fmi3OK;
}

/* The derivative along `seed` of states, outputs and derivatives with respect to states, inputs and parameters. */
EXPORT fmi3Status fmi3GetDirectionalDerivative(
    fmi3Instance instance, const fmi3ValueReference unknowns[], size_t unknown_count,
    const fmi3ValueReference knowns[], size_t known_count, const fmi3Float64 seed[], size_t seeds,
    fmi3Float64 sensitivity[], size_t sensitivities)
{
    unit *self = instance;
    const snapshot *now = &self->now;
    model_state state, rates;
    model_inputs inputs;
    model_parameters parameters;
    model_outputs outputs;
    size_t i;

    if (known_count != seeds || unknown_count != sensitivities)
        return fail(self, "all variables are scalars: give one value for each reference.");
    memset(&state, 0, sizeof state);
    memset(&inputs, 0, sizeof inputs);
    memset(&parameters, 0, sizeof parameters);
    for (i = 0; i < known_count; i++) {
        fmi3ValueReference at = knowns[i];
        if (at < FIRST_STATE || at >= FIRST_OUTPUT)
            return fail(self, "derivatives are with respect to states, inputs and parameters.");
        if (at >= FIRST_PARAMETER)
            set_field(&parameters, at - FIRST_PARAMETER, field(&parameters, at - FIRST_PARAMETER) + seed[i]);
        else if (at >= FIRST_INPUT)
            set_field(&inputs, at - FIRST_INPUT, field(&inputs, at - FIRST_INPUT) + seed[i]);
        else
            set_field(&state, at - FIRST_STATE, field(&state, at - FIRST_STATE) + seed[i]);
    }
    model_tangent(now->time, &now->state, &now->inputs, &now->parameters, &state, &inputs, &parameters, &rates,
                  &outputs);
    for (i = 0; i < unknown_count; i++) {
        fmi3ValueReference at = unknowns[i];
        if (at < FIRST_STATE || (at >= FIRST_INPUT && at < FIRST_OUTPUT) || at >= BEYOND)
            return fail(self, "derivatives are those of states, outputs and derivatives of states.");
        sensitivity[i] = at >= FIRST_DERIVATIVE ? field(&rates, at - FIRST_DERIVATIVE)
                         : at >= FIRST_OUTPUT   ? field(&outputs, at - FIRST_OUTPUT)
                                                : field(&state, at - FIRST_STATE);
    }
    return fmi3OK;
}

EXPORT fmi3Status fmi3GetAdjointDerivative(
    fmi3Instance instance, const fmi3ValueReference unknowns[], size_t unknown_count,
    const fmi3ValueReference knowns[], size_t known_count, const fmi3Float64 seed[], size_t seeds,
    fmi3Float64 sensitivity[], size_t sensitivities)
{
    (void)unknowns, (void)unknown_count, (void)knowns, (void)known_count, (void)seed, (void)seeds;
    (void)sensitivity, (void)sensitivities;
    return fail(instance, "adjoint derivatives are not provided: use directional derivatives.");
}

EXPORT fmi3Status fmi3EnterConfigurationMode(fmi3Instance instance)
{
    return fail(instance, "there are no structural parameters.");
}

EXPORT fmi3Status fmi3ExitConfigurationMode(fmi3Instance instance)
{
    return fail(instance, "there are no structural parameters.");
}

/* There are no clocks. */
#define NO_CLOCKS(NAME, UNUSED, ...)                                                                                 \
    EXPORT fmi3Status fmi3##NAME(                                                                                    \
        fmi3Instance instance, const fmi3ValueReference references[], size_t count, __VA_ARGS__)                     \
    {                                                                                                                \
        (void)references, UNUSED;                                                                                    \
        return count ? fail(instance, "there are no clocks.") : fmi3OK;                                              \
    }
#define ONE ((void)first)
#define TWO ((void)first, (void)second)
#define THREE ((void)first, (void)second, (void)third)

NO_CLOCKS(GetIntervalDecimal, TWO, fmi3Float64 first[], fmi3IntervalQualifier second[])
NO_CLOCKS(GetIntervalFraction, THREE, fmi3UInt64 first[], fmi3UInt64 second[], fmi3IntervalQualifier third[])
NO_CLOCKS(GetShiftDecimal, ONE, fmi3Float64 first[])
NO_CLOCKS(GetShiftFraction, TWO, fmi3UInt64 first[], fmi3UInt64 second[])
NO_CLOCKS(SetIntervalDecimal, ONE, const fmi3Float64 first[])
NO_CLOCKS(SetIntervalFraction, TWO, const fmi3UInt64 first[], const fmi3UInt64 second[])
NO_CLOCKS(SetShiftDecimal, ONE, const fmi3Float64 first[])
NO_CLOCKS(SetShiftFraction, TWO, const fmi3UInt64 first[], const fmi3UInt64 second[])

EXPORT fmi3Status fmi3EvaluateDiscreteStates(fmi3Instance instance)
{
    (void)instance;
    return fmi3OK;
}

EXPORT fmi3Status fmi3UpdateDiscreteStates(
    fmi3Instance instance, fmi3Boolean *needs_update, fmi3Boolean *terminate, fmi3Boolean *nominals_changed,
    fmi3Boolean *values_changed, fmi3Boolean *next_event_defined, fmi3Float64 *next_event)
{
    unit *self = instance;
    snapshot moved = self->now;

    *needs_update = *terminate = *nominals_changed = *values_changed = *next_event_defined = false;
    *next_event = 0.0;
    if (self->now.phase != EVENT)
        return fail(self, "discrete states are updated in event mode.");
    if (MODEL_PROJECTS && projected(&moved) > DRIFT) {
        self->now = moved;
        *values_changed = true;
    }
    return fmi3OK;
}

EXPORT fmi3Status fmi3EnterContinuousTimeMode(fmi3Instance instance)
{
    unit *self = instance;

    if (self->now.phase != EVENT)
        return fail(self, "continuous-time mode is entered from event mode, in model exchange.");
    self->now.phase = CONTINUOUS_TIME;
    return fmi3OK;
}

EXPORT fmi3Status fmi3CompletedIntegratorStep(
    fmi3Instance instance, fmi3Boolean no_return, fmi3Boolean *enter_event_mode, fmi3Boolean *terminate)
{
    snapshot moved = ((unit *)instance)->now;

    (void)no_return;
    *enter_event_mode = MODEL_PROJECTS && projected(&moved) > DRIFT;
    *terminate = false;
    return fmi3OK;
}

EXPORT fmi3Status fmi3SetTime(fmi3Instance instance, fmi3Float64 time)
{
    ((unit *)instance)->now.time = time;
    return fmi3OK;
}

EXPORT fmi3Status fmi3SetContinuousStates(fmi3Instance instance, const fmi3Float64 states[], size_t count)
{
    unit *self = instance;

    if (self->now.phase != CONTINUOUS_TIME || count != MODEL_STATES)
        return fail(self, "all states are set at once, in continuous-time mode.");
    memcpy(&self->now.state, states, sizeof self->now.state);
    return fmi3OK;
}

EXPORT fmi3Status fmi3GetContinuousStates(fmi3Instance instance, fmi3Float64 states[], size_t count)
{
    unit *self = instance;

    if (count != MODEL_STATES)
        return fail(self, "ask for all states at once.");
    memcpy(states, &self->now.state, sizeof self->now.state);
    return fmi3OK;
}

EXPORT fmi3Status fmi3GetContinuousStateDerivatives(fmi3Instance instance, fmi3Float64 derivatives[], size_t count)
{
    unit *self = instance;
    model_state rates;

    if (count != MODEL_STATES)
        return fail(self, "ask for all derivatives at once.");
    model_rates(self->now.time, &self->now.state, &self->now.inputs, &self->now.parameters, &rates);
    memcpy(derivatives, &rates, sizeof rates);
    return fmi3OK;
}

EXPORT fmi3Status fmi3GetNominalsOfContinuousStates(fmi3Instance instance, fmi3Float64 nominals[], size_t count)
{
    static const double values[] = {MODEL_NOMINALS};

    if (count != MODEL_STATES)
        return fail(instance, "ask for all nominal values at once.");
    memcpy(nominals, values, sizeof values);
    return fmi3OK;
}

EXPORT fmi3Status fmi3GetNumberOfContinuousStates(fmi3Instance instance, size_t *count)
{
    (void)instance;
    *count = MODEL_SAMPLED ? 0 : MODEL_STATES;
    return fmi3OK;
}

EXPORT fmi3Status fmi3GetEventIndicators(fmi3Instance instance, fmi3Float64 indicators[], size_t count)
{
    (void)indicators;
    return count ? fail(instance, "there are no event indicators.") : fmi3OK;
}

EXPORT fmi3Status fmi3GetNumberOfEventIndicators(fmi3Instance instance, size_t *count)
{
    (void)instance;
    *count = 0;
    return fmi3OK;
}

EXPORT fmi3Status fmi3EnterStepMode(fmi3Instance instance)
{
    return fail(instance, "this unit has no event mode in co-simulation, and so is always in step mode.");
}

EXPORT fmi3Status fmi3GetOutputDerivatives(
    fmi3Instance instance, const fmi3ValueReference references[], size_t count, const fmi3Int32 orders[],
    fmi3Float64 values[], size_t sizes)
{
    (void)references, (void)orders, (void)values, (void)sizes;
    return count ? fail(instance, "derivatives of outputs are not provided.") : fmi3OK;
}

static int step(snapshot *now, double from, double to, double h)
{
    if (!model_step_between(&now->state, &now->history, &now->inputs, &now->parameters, now->index, from, to, h))
        return 0;
    now->index++;
    now->time = to;
    return 1;
}

/*
 * Steps of MODEL_STEP where they fill the communication step, so that the results are those of the simulation to the
 * bit; otherwise equal shorter ones.
 */
EXPORT fmi3Status fmi3DoStep(
    fmi3Instance instance, fmi3Float64 point, fmi3Float64 size, fmi3Boolean no_return, fmi3Boolean *events,
    fmi3Boolean *terminate, fmi3Boolean *early_return, fmi3Float64 *last_time)
{
    unit *self = instance;
    snapshot *now = &self->now;
    double count = size / MODEL_STEP, begin = now->time, h = MODEL_STEP;
    int fills = fabs(count - floor(count + 0.5)) <= TIME_TOLERANCE * (1.0 + count);
    int64_t steps = (int64_t)(fills ? floor(count + 0.5) : ceil(count)), k;

    (void)no_return;
    *events = *terminate = *early_return = false;
    *last_time = begin;
    if (now->phase != STEP)
        return fail(self, "steps are taken after the initialization, in co-simulation.");
    if (!(size > 0.0) || !(fabs(point - begin) <= TIME_TOLERANCE * (fabs(begin) + MODEL_STEP)))
        return fail(self, "the communication step is not positive, or does not begin where the last one ended.");
    if (MODEL_SAMPLED && !fills)
        return fail(self, "sampled controllers and delays need communication steps that are multiples of stepSize.");
    if (!fills)
        h = size / (double)steps;
    for (k = 0; k < steps; k++) {
        double from = begin + (double)k * h, to = begin + (double)(k + 1) * h;
        if (fills) {
            from = now->origin + (double)now->index * h;
            to = now->origin + (double)(now->index + 1) * h;
        }
        if (!step(now, from, to, h))
            return fail(self, "the state would become infinite: use shorter steps, or check inputs and parameters.");
        *last_time = to;
    }
    if (!fills) {
        now->origin = now->time = begin + size;
        now->index = 0;
        *last_time = now->time;
    }
    return fmi3OK;
}

EXPORT fmi3Status fmi3ActivateModelPartition(fmi3Instance instance, fmi3ValueReference clock, fmi3Float64 time)
{
    (void)clock, (void)time;
    return fail(instance, "scheduled execution is not supported.");
}
