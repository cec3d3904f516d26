// Pinocchio's model from the text that robots.py writes: joint by joint kind, parent, placement, inertia.
#pragma once

#include <pinocchio/multibody.hpp>

#include <fstream>
#include <iostream>
#include <string>

namespace bench {

// The text comes from the model that Pinocchio itself made of the URDF. Reading it here keeps the program free of
// libraries that were compiled for other vector units, which would change how Eigen aligns memory.
inline pinocchio::Model read_model(const char *path)
{
    std::ifstream file(path);
    pinocchio::Model model;
    int joints = 0;
    file >> joints >> model.gravity.linear()[0] >> model.gravity.linear()[1] >> model.gravity.linear()[2];
    for (int k = 0; k < joints; ++k) {
        std::string kind;
        std::size_t parent = 0;
        pinocchio::SE3 placement;
        double mass = 0;
        Eigen::Vector3d lever;
        Eigen::Matrix3d inertia;
        file >> kind >> parent;
        for (int i = 0; i < 9; ++i) {
            file >> placement.rotation()(i / 3, i % 3);
        }
        for (int i = 0; i < 3; ++i) {
            file >> placement.translation()[i];
        }
        file >> mass >> lever[0] >> lever[1] >> lever[2];
        for (int i = 0; i < 9; ++i) {
            file >> inertia(i / 3, i % 3);
        }
        const std::string name = "joint" + std::to_string(k + 1);
        const auto added = kind == "R" ? model.addJoint(parent, pinocchio::JointModelRZ(), placement, name)
                                       : model.addJoint(parent, pinocchio::JointModelPZ(), placement, name);
        model.appendBodyToJoint(added, pinocchio::Inertia(mass, lever, inertia), pinocchio::SE3::Identity());
    }
    if (!file) {
        std::cerr << path << ": no model\n";
        std::exit(2);
    }
    return model;
}

} // namespace bench
