#!/usr/bin/env python3
"""A minimal rclpy node for comparison: the same model, without gates, supervisor and residual.

Receives displacement, coil_current and measured_force, and publishes force_estimate: fuzzy sets over the current with a tanh function
under each, on a low-passed difference of displacement. The coefficients are not from a damper; only the time is measured.
"""

import math

import rclpy
from mr_damper_msgs.msg import CoilCurrent, Displacement, Force, ForceEstimate
from rclpy.node import Node

from ros_common import qos, to_ns

# Centre, A; height, N; damping, N s/m; slope, s/m; coupling, 1/s.
SETS = [(c, 150.0 + 300.0 * c, 900.0 + 200.0 * c, 25.0, -1.5) for c in (0.0, 0.4, 0.8, 1.2, 1.6, 2.1, 2.5)]
SIGMA_A = 0.2
TAU_S = 0.008


class Damper(Node):
    def __init__(self):
        super().__init__("mr_damper_rclpy")
        self.current = 0.0
        self.before = None
        self.velocity = 0.0
        self.estimates = self.create_publisher(ForceEstimate, "force_estimate", qos(10))
        self.create_subscription(CoilCurrent, "coil_current", self.on_current, qos(256))
        self.create_subscription(Force, "measured_force", lambda _: None, qos(256))
        self.create_subscription(Displacement, "displacement", self.on_displacement, qos(256))

    def on_current(self, message):
        self.current = message.current

    def on_displacement(self, message):
        ns, x = to_ns(message.header.stamp), message.displacement
        if self.before is not None and ns > self.before[0]:
            dt = (ns - self.before[0]) * 1e-9
            share = 1.0 - math.exp(-dt / TAU_S)
            self.velocity += share * ((x - self.before[1]) / dt - self.velocity)
        self.before = (ns, x)
        weighted = weights = 0.0
        for centre, height, damping, slope, coupling in SETS:
            weight = math.exp(-((self.current - centre) ** 2) / (2.0 * SIGMA_A**2))
            u = self.velocity + coupling * x
            weighted += weight * (height * math.tanh(slope * u) + damping * u)
            weights += weight
        estimate = ForceEstimate()
        estimate.header = message.header
        estimate.force = weighted / weights
        self.estimates.publish(estimate)


def main():
    rclpy.init()
    try:
        rclpy.spin(Damper())
    except KeyboardInterrupt:
        pass


main()
