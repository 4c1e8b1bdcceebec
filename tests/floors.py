"""Noise of the channels that tests add, root mean square, in the channels' units."""

FLOORS = {"engine_speed": 0.06, "turbine_speed": 0.06, "transmission_output_speed": 0.06, "wheel_speed": 0.012,
          "vehicle_speed": 0.005, "propeller_shaft_torque": 1.5, "seat_acceleration": 0.03,
          "differential_acceleration": 0.5}
