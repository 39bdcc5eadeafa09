// The articulated-body algorithm of Pinocchio in a loop: reads a tree of hinges from the standard input, and writes the least
// processor time (s) of one evaluation in five loops, and the accelerations at the first point.
//
// Input: number of bodies; for each its parent (-1: the fixed frame), the axis of its hinge, the place of the hinge in the
// parent, mass, centre of mass and inertia tensor (row by row); number of evaluations; coordinate and speed of all hinges. An
// axis along x, y or z makes a joint of this axis, as the reader of URDF does.
#include <pinocchio/multibody.hpp>
#include <pinocchio/algorithm/aba.hpp>
#include <algorithm>
#include <cstdio>
#include <ctime>
#include <iostream>
#include <vector>

namespace pin = pinocchio;

static double processor_time() {
    timespec now;
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &now);
    return now.tv_sec + 1e-9 * now.tv_nsec;
}

int main() {
    int bodies, calls;
    pin::Model model;
    model.gravity.linear() << 0, 0, -9.81;
    std::vector<pin::JointIndex> joints;
    std::cin >> bodies;
    for (int k = 0; k < bodies; k++) {
        int parent;
        Eigen::Vector3d axis, shift, centre;
        Eigen::Matrix3d inertia;
        double mass;
        std::cin >> parent;
        for (auto *v : {&axis, &shift}) for (int i = 0; i < 3; i++) std::cin >> (*v)[i];
        std::cin >> mass;
        for (int i = 0; i < 3; i++) std::cin >> centre[i];
        for (int i = 0; i < 9; i++) std::cin >> inertia(i / 3, i % 3);
        pin::JointModel joint = axis == Eigen::Vector3d::UnitX() ? pin::JointModel(pin::JointModelRX())
                              : axis == Eigen::Vector3d::UnitY() ? pin::JointModel(pin::JointModelRY())
                              : axis == Eigen::Vector3d::UnitZ() ? pin::JointModel(pin::JointModelRZ())
                              : pin::JointModel(pin::JointModelRevoluteUnaligned(axis));
        joints.push_back(model.addJoint(parent < 0 ? 0 : joints[parent], joint,
                                        pin::SE3(Eigen::Matrix3d::Identity(), shift), "joint_" + std::to_string(k)));
        model.appendBodyToJoint(joints.back(), pin::Inertia(mass, centre, inertia), pin::SE3::Identity());
    }
    double coordinate, speed;
    std::cin >> calls >> coordinate >> speed;
    pin::Data data(model);
    // other coordinates at each point, as in the loop of the other program
    Eigen::VectorXd q = Eigen::VectorXd::Constant(model.nq, coordinate), v = Eigen::VectorXd::Constant(model.nv, speed);
    Eigen::VectorXd tau = Eigen::VectorXd::Zero(model.nv), first = pin::aba(model, data, q, v, tau);
    double least = 1e9, sum = 0;
    for (int loop = 0; loop < 5; loop++) {
        double begin = processor_time();
        for (int k = 0; k < calls; k++) {
            q[0] = coordinate + 1e-6 * k;
            sum += pin::aba(model, data, q, v, tau)[0];
        }
        least = std::min(least, (processor_time() - begin) / calls);
    }
    std::printf("%.17g", least);
    for (int k = 0; k < bodies; k++) std::printf(" %.17g", first[k]);
    std::printf("\n");
    return sum == 0.12345;  // the sum is used, so that no call is omitted
}
