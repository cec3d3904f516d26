// Pinocchio's algorithms on doubles; the model is read from the file named by the environment variable MODEL.
#include "model.hpp"

#include <pinocchio/algorithm/aba-derivatives.hpp>
#include <pinocchio/algorithm/aba.hpp>
#include <pinocchio/algorithm/crba.hpp>
#include <pinocchio/algorithm/regressor.hpp>
#include <pinocchio/algorithm/rnea-derivatives.hpp>
#include <pinocchio/algorithm/rnea-second-order-derivatives.hpp>
#include <pinocchio/algorithm/rnea.hpp>

#include "contender.hpp"

#include <cstdlib>

namespace {

using Vector = Eigen::VectorXd;
using pinocchio::Convention;

struct Work {
    pinocchio::Model model;
    pinocchio::Data data;
    std::vector<Vector> q, dq, ddq, tau;

    Work(const bench::States &states, const char *path) : model(bench::read_model(path)), data(model)
    {
        spread(states, states.q, q);
        spread(states, states.dq, dq);
        spread(states, states.ddq, ddq);
        spread(states, states.tau, tau);
    }

private:
    static void spread(const bench::States &states, const std::vector<double> &flat, std::vector<Vector> &result)
    {
        const auto n = static_cast<Eigen::Index>(states.joints);
        for (std::size_t k = 0; k < states.samples; ++k) {
            result.push_back(Eigen::Map<const Vector>(flat.data() + k * states.joints, n));
        }
    }
};

template <class Matrix> std::vector<double> rows(const Matrix &matrix)
{
    std::vector<double> result;
    for (Eigen::Index i = 0; i < matrix.rows(); ++i) {
        for (Eigen::Index j = 0; j < matrix.cols(); ++j) {
            result.push_back(matrix(i, j));
        }
    }
    return result;
}

// The mass matrix comes as its upper triangle.
std::vector<double> symmetric(const Eigen::MatrixXd &matrix)
{
    return rows(Eigen::MatrixXd(matrix.selfadjointView<Eigen::Upper>()));
}

std::vector<double> join(std::vector<std::vector<double>> parts)
{
    std::vector<double> result;
    for (const auto &part : parts) {
        result.insert(result.end(), part.begin(), part.end());
    }
    return result;
}

template <class Tensor> std::vector<double> entries(const Tensor &tensor)
{
    std::vector<double> result;
    for (Eigen::Index i = 0; i < tensor.dimension(0); ++i) {
        for (Eigen::Index j = 0; j < tensor.dimension(1); ++j) {
            for (Eigen::Index k = 0; k < tensor.dimension(2); ++k) {
                result.push_back(tensor(i, j, k));
            }
        }
    }
    return result;
}

// The algorithms of the derivatives only add to what is zero, but do not clear it themselves.
void derive_twice(Work &w, std::size_t k)
{
    auto &data = w.data;
    for (auto *tensor : {&data.d2tau_dqdq, &data.d2tau_dvdv, &data.d2tau_dqdv, &data.d2tau_dadq}) {
        tensor->setZero();
    }
    pinocchio::ComputeRNEASecondOrderDerivatives(w.model, data, w.q[k], w.dq[k], w.ddq[k], data.d2tau_dqdq,
                                                 data.d2tau_dvdv, data.d2tau_dqdv, data.d2tau_dadq);
}

} // namespace

// The mass matrix and forward dynamics exist in two forms, in frames of the links and of the world.
std::vector<bench::Entry> bench::list_entries()
{
    return {
        ENTRY("inverse_dynamics", pinocchio::rnea(w.model, w.data, w.q[k], w.dq[k], w.ddq[k]), rows(w.data.tau)),
        ENTRY("gravity", pinocchio::computeGeneralizedGravity(w.model, w.data, w.q[k]), rows(w.data.g)),
        ENTRY("mass_matrix", pinocchio::crba(w.model, w.data, w.q[k], Convention::LOCAL), symmetric(w.data.M)),
        ENTRY("mass_matrix:world", pinocchio::crba(w.model, w.data, w.q[k], Convention::WORLD), symmetric(w.data.M)),
        ENTRY("coriolis_matrix", pinocchio::computeCoriolisMatrix(w.model, w.data, w.q[k], w.dq[k]), rows(w.data.C)),
        ENTRY("forward_dynamics",
              pinocchio::aba(w.model, w.data, w.q[k], w.dq[k], w.tau[k], Convention::LOCAL), rows(w.data.ddq)),
        ENTRY("forward_dynamics:world",
              pinocchio::aba(w.model, w.data, w.q[k], w.dq[k], w.tau[k], Convention::WORLD), rows(w.data.ddq)),
        ENTRY("kinetic_energy_regressor",
              pinocchio::computeKineticEnergyRegressor(w.model, w.data, w.q[k], w.dq[k]),
              rows(w.data.kineticEnergyRegressor)),
        ENTRY("potential_energy_regressor", pinocchio::computePotentialEnergyRegressor(w.model, w.data, w.q[k]),
              rows(w.data.potentialEnergyRegressor)),
        ENTRY("torque_regressor",
              pinocchio::computeJointTorqueRegressor(w.model, w.data, w.q[k], w.dq[k], w.ddq[k]),
              rows(w.data.jointTorqueRegressor)),
        ENTRY("inverse_dynamics_derivatives",
              pinocchio::computeRNEADerivatives(w.model, w.data, w.q[k], w.dq[k], w.ddq[k]),
              join({rows(w.data.dtau_dq), rows(w.data.dtau_dv), symmetric(w.data.M)})),
        ENTRY("forward_dynamics_derivatives",
              pinocchio::computeABADerivatives(w.model, w.data, w.q[k], w.dq[k], w.tau[k]),
              join({rows(w.data.ddq), rows(w.data.ddq_dq), rows(w.data.ddq_dv), symmetric(w.data.Minv)})),
        ENTRY("inverse_dynamics_second_derivatives", derive_twice(w, k),
              join({entries(w.data.d2tau_dqdq), entries(w.data.d2tau_dvdv), entries(w.data.d2tau_dqdv),
                    entries(w.data.d2tau_dadq)})),
    };
}

void *bench::open_contender(const States &states)
{
    const char *path = std::getenv("MODEL");
    if (path == nullptr) {
        std::cerr << "MODEL is not set\n";
        std::exit(2);
    }
    // Lives as long as the program.
    return new Work(states, path);
}
