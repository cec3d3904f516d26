// What CasADi printed for Pinocchio's algorithms. Compiled with its header by -include.
#include "contender.hpp"

namespace {

struct Work {
    bench::States states;
    std::size_t n;
    std::vector<double> out;
    const double *arguments[4] = {};
    double *results[1] = {};

    explicit Work(const bench::States &given) : states(given), n(given.joints), out(n * 10 * n), results{out.data()} {}

    const double *q(std::size_t k) const { return states.q.data() + k * n; }
    const double *dq(std::size_t k) const { return states.dq.data() + k * n; }
    const double *ddq(std::size_t k) const { return states.ddq.data() + k * n; }
    const double *tau(std::size_t k) const { return states.tau.data() + k * n; }
    const double *pi() const { return states.pi.data(); }

    // Functions of scalars keep their values in local variables and need no work vectors.
    template <class Function, class... Inputs> void call(Function function, Inputs... inputs)
    {
        std::size_t place = 0;
        ((arguments[place++] = inputs), ...);
        function(arguments, results, nullptr, nullptr, 0);
    }

    std::vector<double> cut(casadi_int size) const { return {out.begin(), out.begin() + size}; }
};

#define TRACED(name, function, ...)                                                                              \
    ENTRY(name, w.call(function, __VA_ARGS__), w.cut(function##_sparsity_out(0)[0]))

#define PAIR(name, ...)                                                                                          \
    TRACED(#name, arg_##name, __VA_ARGS__, w.pi()), TRACED(#name ":constant", con_##name, __VA_ARGS__)

} // namespace

std::vector<bench::Entry> bench::list_entries()
{
    return {
        PAIR(inverse_dynamics, w.q(k), w.dq(k), w.ddq(k)),
        PAIR(gravity, w.q(k)),
        PAIR(mass_matrix, w.q(k)),
        PAIR(coriolis_matrix, w.q(k), w.dq(k)),
        PAIR(forward_dynamics, w.q(k), w.dq(k), w.tau(k)),
        TRACED("kinetic_energy_regressor", con_kinetic_energy_regressor, w.q(k), w.dq(k)),
        TRACED("potential_energy_regressor", con_potential_energy_regressor, w.q(k)),
        TRACED("torque_regressor", con_torque_regressor, w.q(k), w.dq(k), w.ddq(k)),
        TRACED("torque_regressor:base", con_torque_regressor_base, w.q(k), w.dq(k), w.ddq(k)),
    };
}

void *bench::open_contender(const States &states)
{
    // Lives as long as the program.
    return new Work(states);
}
