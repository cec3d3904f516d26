// The functions that symid generates. Compiled with -DPREFIX=symid_NAME, the header by -include, and -DLARGE where
// the robot has too many joints for derivatives of forward dynamics.
#include "contender.hpp"

#include <algorithm>

#define JOIN_(a, b) a##_##b
#define JOIN(a, b) JOIN_(a, b)
#define F(name) JOIN(PREFIX, name)
#define BATCH(name) JOIN(JOIN(PREFIX, name), batch)

namespace {

struct Work {
    bench::States states;
    std::size_t n, b;
    // Outputs of one sample, and of all of them for the batch; `also` is the second output, `more` and `rest` the
    // third and the fourth.
    std::vector<double> out, also, more, rest, all, all_also, all_more, all_rest;

    explicit Work(const bench::States &given) : states(given), n(given.joints), b(given.beta.size())
    {
        const std::size_t size = n * std::max(n, b);
        out.resize(size);
        also.resize(size);
        more.resize(n * n);
        rest.resize(n * n);
        all.resize(size * states.samples);
        all_also.resize(size * states.samples);
        all_more.resize(n * n * states.samples);
        all_rest.resize(n * n * states.samples);
    }

    const double *q(std::size_t k) const { return states.q.data() + k * n; }
    const double *dq(std::size_t k) const { return states.dq.data() + k * n; }
    const double *ddq(std::size_t k) const { return states.ddq.data() + k * n; }
    const double *tau(std::size_t k) const { return states.tau.data() + k * n; }
    const double *beta() const { return states.beta.data(); }
};

std::vector<double> cut(const std::vector<double> &values, std::size_t size, std::size_t sample = 0)
{
    const auto start = values.begin() + static_cast<std::ptrdiff_t>(size * sample);
    return {start, start + static_cast<std::ptrdiff_t>(size)};
}

std::vector<double> join(std::vector<std::vector<double>> parts)
{
    std::vector<double> result;
    for (const auto &part : parts) {
        result.insert(result.end(), part.begin(), part.end());
    }
    return result;
}

// The batch takes a range of samples in one call, `block` at a time, always to the same place.
#define BLOCK_ENTRY(name, block, call, output)                                                                   \
    bench::Entry                                                                                                 \
    {                                                                                                            \
        name,                                                                                                    \
            [](void *self, std::size_t begin, std::size_t end) {                                                 \
                auto &w = *static_cast<Work *>(self);                                                            \
                for (std::size_t k = begin; k < end; k += block) {                                               \
                    const std::size_t count = std::min<std::size_t>(block, end - k);                             \
                    call;                                                                                        \
                }                                                                                                \
            },                                                                                                   \
            [](void *self, std::size_t k) -> std::vector<double> {                                               \
                auto &w = *static_cast<Work *>(self);                                                            \
                const std::size_t count = std::min<std::size_t>(block, w.states.samples - k);                    \
                if (k % block == 0) {                                                                            \
                    call;                                                                                        \
                }                                                                                                \
                const std::size_t place = k % block;                                                             \
                return output;                                                                                   \
            }                                                                                                    \
    }

// Results of 128 samples stay in the processor's cache, as the one result of other libraries does; those of 1000
// regressors may not.
#define BATCH_ENTRY_OF(name, call, output)                                                                       \
    BLOCK_ENTRY(name ":batch", 128, call, output), BLOCK_ENTRY(name ":batch-1000", 1000, call, output)
#define BATCH_ENTRY(name, call, values, size) BATCH_ENTRY_OF(name, call, cut(values, size, place))

} // namespace

std::vector<bench::Entry> bench::list_entries()
{
    return {
        ENTRY("inverse_dynamics", F(inverse_dynamics)(w.q(k), w.dq(k), w.ddq(k), w.beta(), w.out.data()),
              cut(w.out, w.n)),
        ENTRY("gravity", F(gravity)(w.q(k), w.beta(), w.out.data()), cut(w.out, w.n)),
        ENTRY("mass_matrix", F(mass_matrix)(w.q(k), w.beta(), w.out.data()), cut(w.out, w.n * w.n)),
        ENTRY("coriolis_matrix", F(coriolis_matrix)(w.q(k), w.dq(k), w.beta(), w.out.data()), cut(w.out, w.n * w.n)),
        ENTRY("forward_dynamics", F(forward_dynamics)(w.q(k), w.dq(k), w.tau(k), w.beta(), w.out.data()),
              cut(w.out, w.n)),
        ENTRY("kinetic_energy_regressor", F(energy_regressor)(w.q(k), w.dq(k), w.out.data(), w.also.data()),
              cut(w.out, w.b)),
        ENTRY("potential_energy_regressor", F(energy_regressor)(w.q(k), w.dq(k), w.out.data(), w.also.data()),
              cut(w.also, w.b)),
        ENTRY("torque_regressor", F(torque_regressor)(w.q(k), w.dq(k), w.ddq(k), w.out.data()),
              cut(w.out, w.n * w.b)),
        ENTRY("inverse_dynamics_derivatives",
              F(inverse_dynamics_derivatives)(w.q(k), w.dq(k), w.ddq(k), w.beta(), w.out.data(), w.also.data(),
                                              w.more.data()),
              join({cut(w.out, w.n * w.n), cut(w.also, w.n * w.n), w.more})),
#ifndef LARGE
        ENTRY("forward_dynamics_derivatives",
              F(forward_dynamics_derivatives)(w.q(k), w.dq(k), w.tau(k), w.beta(), w.out.data(), w.also.data(),
                                              w.more.data(), w.rest.data()),
              join({cut(w.out, w.n), cut(w.also, w.n * w.n), w.more, w.rest})),
#endif
        BATCH_ENTRY("inverse_dynamics",
                    BATCH(inverse_dynamics)(count, w.q(k), w.dq(k), w.ddq(k), w.beta(), w.all.data()), w.all, w.n),
        BATCH_ENTRY("gravity", BATCH(gravity)(count, w.q(k), w.beta(), w.all.data()), w.all, w.n),
        BATCH_ENTRY("mass_matrix", BATCH(mass_matrix)(count, w.q(k), w.beta(), w.all.data()), w.all, w.n *w.n),
        BATCH_ENTRY("coriolis_matrix",
                    BATCH(coriolis_matrix)(count, w.q(k), w.dq(k), w.beta(), w.all.data()), w.all, w.n *w.n),
        BATCH_ENTRY("forward_dynamics",
                    BATCH(forward_dynamics)(count, w.q(k), w.dq(k), w.tau(k), w.beta(), w.all.data()), w.all, w.n),
        BATCH_ENTRY("kinetic_energy_regressor",
                    BATCH(energy_regressor)(count, w.q(k), w.dq(k), w.all.data(), w.all_also.data()), w.all, w.b),
        BATCH_ENTRY("potential_energy_regressor",
                    BATCH(energy_regressor)(count, w.q(k), w.dq(k), w.all.data(), w.all_also.data()), w.all_also,
                    w.b),
        BATCH_ENTRY("torque_regressor",
                    BATCH(torque_regressor)(count, w.q(k), w.dq(k), w.ddq(k), w.all.data()), w.all, w.n *w.b),
        BATCH_ENTRY_OF("inverse_dynamics_derivatives",
                       BATCH(inverse_dynamics_derivatives)(count, w.q(k), w.dq(k), w.ddq(k), w.beta(), w.all.data(),
                                                           w.all_also.data(), w.all_more.data()),
                       join({cut(w.all, w.n * w.n, place), cut(w.all_also, w.n * w.n, place),
                             cut(w.all_more, w.n * w.n, place)})),
#ifndef LARGE
        BATCH_ENTRY_OF("forward_dynamics_derivatives",
                       BATCH(forward_dynamics_derivatives)(count, w.q(k), w.dq(k), w.tau(k), w.beta(), w.all.data(),
                                                           w.all_also.data(), w.all_more.data(),
                                                           w.all_rest.data()),
                       join({cut(w.all, w.n, place), cut(w.all_also, w.n * w.n, place),
                             cut(w.all_more, w.n * w.n, place), cut(w.all_rest, w.n * w.n, place)})),
#endif
    };
}

void *bench::open_contender(const States &states)
{
    // Lives as long as the program.
    return new Work(states);
}
