#include "symid_lever.h"
#include "lever_values.h"
#include <stdio.h>

int main(void)
{
    const double q[1] = {0.5}, dq[1] = {0.2}, ddq[1] = {1.0};
    double g[1], tau[1];
    symid_lever_gravity(q, symid_lever_beta, g);
    symid_lever_inverse_dynamics(q, dq, ddq, symid_lever_beta, tau);
    printf("gravity %.4f N m, torque %.4f N m\n", g[0], tau[0]);
    return 0;
}
