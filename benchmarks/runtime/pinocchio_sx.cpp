// Pinocchio's algorithms traced over CasADi's SX and printed as C by CasADi.
// Called as: PROGRAM MODEL COLUMNS FILE.c, in the folder where the file shall stand. COLUMNS holds the indices of
// the base columns of the torque regressor.
//
// Functions named arg_* take the bodies as an argument: mass, centre of mass, and xx xy yy xz yz zz about it, link
// after link; con_* have them as numbers. Where Pinocchio has two forms of an algorithm, the one with fewer
// operations is taken; common parts are merged.
#include <pinocchio/autodiff/casadi.hpp>

#include "model.hpp"

#include <pinocchio/algorithm/aba.hpp>
#include <pinocchio/algorithm/crba.hpp>
#include <pinocchio/algorithm/regressor.hpp>
#include <pinocchio/algorithm/rnea.hpp>

#include <casadi/casadi.hpp>

namespace {

using casadi::Function;
using casadi::SX;
using pinocchio::Convention;
using Model = pinocchio::ModelTpl<SX>;
using Data = pinocchio::DataTpl<SX>;
using Vector = Eigen::Matrix<SX, Eigen::Dynamic, 1>;

Vector spread(const SX &column)
{
    Vector result(column.size1());
    for (casadi_int k = 0; k < column.size1(); ++k) {
        result[k] = column(k);
    }
    return result;
}

template <class Matrix> SX rows(const Matrix &matrix, const std::vector<Eigen::Index> &columns)
{
    std::vector<SX> result;
    for (Eigen::Index i = 0; i < matrix.rows(); ++i) {
        for (const auto j : columns) {
            result.push_back(SX::densify(matrix(i, j)));
        }
    }
    return SX::vertcat(result);
}

template <class Matrix> SX rows(const Matrix &matrix)
{
    std::vector<Eigen::Index> all(static_cast<std::size_t>(matrix.cols()));
    for (std::size_t k = 0; k < all.size(); ++k) {
        all[k] = static_cast<Eigen::Index>(k);
    }
    return rows(matrix, all);
}

// The upper triangle is what crba computes.
template <class Matrix> SX symmetric_rows(const Matrix &matrix)
{
    std::vector<SX> result;
    for (Eigen::Index i = 0; i < matrix.rows(); ++i) {
        for (Eigen::Index j = 0; j < matrix.cols(); ++j) {
            result.push_back(SX::densify(matrix(std::min(i, j), std::max(i, j))));
        }
    }
    return SX::vertcat(result);
}

Model set_bodies(const pinocchio::Model &numbers, const SX &pi)
{
    Model model = numbers.cast<SX>();
    for (int k = 0; k < numbers.nv; ++k) {
        const auto p = [&](int i) { return SX(pi(10 * k + i)); };
        const pinocchio::Symmetric3Tpl<SX> inertia(p(4), p(5), p(6), p(7), p(8), p(9));
        Eigen::Matrix<SX, 3, 1> lever;
        lever << p(1), p(2), p(3);
        model.inertias[static_cast<std::size_t>(k) + 1] = pinocchio::InertiaTpl<SX>(p(0), lever, inertia);
    }
    return model;
}

Function take_shorter(const Function &a, const Function &b)
{
    return a.n_instructions() <= b.n_instructions() ? a : b;
}

struct Tracer {
    Model model;
    std::string prefix;
    std::vector<SX> bodies;
    SX q, dq, ddq, tau;
    Data data;
    Vector vq, vdq, vddq, vtau;

    Tracer(const Model &given, const std::string &start, const std::vector<SX> &pi)
        : model(given), prefix(start), bodies(pi), q(SX::sym("q", given.nq)), dq(SX::sym("dq", given.nv)),
          ddq(SX::sym("ddq", given.nv)), tau(SX::sym("tau", given.nv)), data(model), vq(spread(q)), vdq(spread(dq)),
          vddq(spread(ddq)), vtau(spread(tau))
    {
    }

    Function make(const std::string &name, std::vector<SX> inputs, const SX &output, bool with_bodies = true) const
    {
        if (with_bodies) {
            inputs.insert(inputs.end(), bodies.begin(), bodies.end());
        }
        const auto merged = SX::cse(std::vector<SX>{output});
        return take_shorter(Function(prefix + name, inputs, {output}), Function(prefix + name, inputs, merged));
    }

    std::vector<Function> trace()
    {
        std::vector<Function> result;
        pinocchio::rnea(model, data, vq, vdq, vddq);
        result.push_back(make("inverse_dynamics", {q, dq, ddq}, rows(data.tau)));
        pinocchio::computeGeneralizedGravity(model, data, vq);
        result.push_back(make("gravity", {q}, rows(data.g)));
        result.push_back(take_shorter(trace_mass(Convention::LOCAL), trace_mass(Convention::WORLD)));
        pinocchio::computeCoriolisMatrix(model, data, vq, vdq);
        result.push_back(make("coriolis_matrix", {q, dq}, rows(data.C)));
        result.push_back(take_shorter(trace_forward(Convention::LOCAL), trace_forward(Convention::WORLD)));
        return result;
    }

    std::vector<Function> trace_regressors(const std::vector<Eigen::Index> &columns)
    {
        std::vector<Function> result;
        Data fresh(model);
        pinocchio::computeKineticEnergyRegressor(model, fresh, vq, vdq);
        result.push_back(make("kinetic_energy_regressor", {q, dq}, rows(fresh.kineticEnergyRegressor), false));
        pinocchio::computePotentialEnergyRegressor(model, fresh, vq);
        result.push_back(make("potential_energy_regressor", {q}, rows(fresh.potentialEnergyRegressor), false));
        pinocchio::computeJointTorqueRegressor(model, fresh, vq, vdq, vddq);
        const auto &full = fresh.jointTorqueRegressor;
        result.push_back(make("torque_regressor", {q, dq, ddq}, rows(full), false));
        result.push_back(make("torque_regressor_base", {q, dq, ddq}, rows(full, columns), false));
        return result;
    }

private:
    Function trace_mass(Convention convention)
    {
        Data fresh(model);
        pinocchio::crba(model, fresh, vq, convention);
        return make("mass_matrix", {q}, symmetric_rows(fresh.M));
    }

    Function trace_forward(Convention convention)
    {
        Data fresh(model);
        pinocchio::aba(model, fresh, vq, vdq, vtau, convention);
        return make("forward_dynamics", {q, dq, tau}, rows(fresh.ddq));
    }
};

} // namespace

int main(int argc, char **argv)
{
    if (argc != 4) {
        std::cerr << "usage: " << argv[0] << " MODEL COLUMNS FILE.c\n";
        return 2;
    }
    const auto numbers = bench::read_model(argv[1]);
    std::ifstream file(argv[2]);
    std::vector<Eigen::Index> columns;
    for (Eigen::Index column = 0; file >> column;) {
        columns.push_back(column);
    }
    const SX pi = SX::sym("pi", 10 * numbers.nv);
    Tracer arguments(set_bodies(numbers, pi), "arg_", {pi});
    Tracer constants(numbers.cast<SX>(), "con_", {});
    casadi::CodeGenerator code(argv[3], casadi::Dict{{"with_header", true}});
    for (const auto &list : {arguments.trace(), constants.trace(), constants.trace_regressors(columns)}) {
        for (const auto &function : list) {
            std::cout << function.name() << " " << function.n_instructions() << "\n";
            code.add(function);
        }
    }
    code.generate();
    return 0;
}
