"""Names of columns as loggers, simulators and standards write them."""

import numpy as np
import pytest
from log_files import CASES

from tuners.logs import LogError, Options
from tuners.logs.columns import _roles, candidates, find
from tuners.logs.names import words
from tuners.logs.table import Column, Table

VEHICLE = CASES["vehicle"]
ROLES = {role.key: role for role in _roles(VEHICLE.plant, Options())}

MEANT = {
    "input": "steer|Steering_Cmd [deg]|delta_f_cmd|Steering, Measured [rad]|SteeringAngle|"
    "steering_angle_deg|carState.steeringAngleDeg|LWI_Lenkradwinkel|Lenkwinkel|Radlenkwinkel|"
    "StW_Angle|Steer_SW|SAS_Angle|VC.Steer.Ang|road_wheel_angle_rad|delta|delta_H|Steer.WhlAng|"
    "steering_tire_angle|u_rad|Angle_StWheel[deg]|steer_req|Soll_Lenkwinkel|STEER_ANGLE|"
    "drive.steering_angle|LRW",
    "output": "yaw_rate|yawRate_dps|omega(rad/s)|ESP_Gierrate|Gierrate [°/s]|psi_dot|psiP|psip_1|"
    "Giergeschwindigkeit|dpsi|AVz|GyroZ [deg/s]|imu.angular_velocity.z|wz|r|y_rad_s|YawVel|"
    "Yaw Rate (deg/s)|Car.YawRate|AngRateZ|heading_rate|Drehrate_z|carState.yawRate|yawspeed|"
    "vehicle_yaw_rate_deg_per_s|GYRO_Z_RATE",
    "v_x": "speed|v|v_ego|VehSpd|Vx|carState.vEgo|Vehicle Speed (km/h)|v_kmh|v_mps|v_Fzg|vVeh|"
    "Fahrzeuggeschwindigkeit [km/h]|ESP_v_Signal|velocity kmh|GPS_Speed|SpeedHorizontal|"
    "twist.linear.x|longitudinal_velocity|Car.v|speedKPH|speed_mph|Vehicle_Speed_Kmh",
    "time": "t|Time [s]|Timestamp_ms|zeit|Uhrzeit|t_ns|sec|time_us|elapsed_time|gps_time|t_s",
}
OTHERS = {
    "input": "SteeringTorque|steering_rate|Lenkradwinkelgeschwindigkeit|steer_rear",
    "output": "y(m)|y [m]|r(m)|yaw [deg]|yaw_angle|YawAcceleration|psi|target_yaw_rate|roll_rate|"
    "yaw_rate_valid|lateral_acceleration|heading|y_pos|YawRateOffset|yaw_rate_std|yaw_error",
    "v_x": "WheelSpeed_FL|v_y|lateral_velocity|speed_limit|v_max|target_speed|EngineSpeed|"
    "steering_speed|v_valid|battery_v|v(V)",
    "time": "date|lap_time|time_to_collision|response_time",
}


@pytest.mark.parametrize("role", MEANT)
def test_a_name_means_one_role(role):
    for name in MEANT[role].split("|"):
        assert [key for key in ROLES if candidates(ROLES[key], [name])] == [role], name


@pytest.mark.parametrize("role", OTHERS)
def test_names_of_other_quantities_mean_none(role):
    for name in OTHERS[role].split("|"):
        assert not candidates(ROLES[role], [name]), name


@pytest.mark.parametrize(
    "name, said",
    [("VehSpd", "veh speed"), ("ESP_Gierrate", "esp yaw rate"), ("psiP", "psi dot"),
     ("carState.vEgo", "car state v ego"), ("yawrate", "yaw rate"),
     ("steering_wheel_angle [deg]", "hand wheel angle")],
)  # fmt: skip
def test_words_of_a_name(name, said):
    assert " ".join(words(name)) == said


def found(**columns):
    table = {"t": np.arange(9.0), "steer": np.ones(9), "yaw_rate": np.ones(9)} | columns
    table = {name: values for name, values in table.items() if values is not None}
    return find(Table(tuple(table), lambda name: Column(table[name])), VEHICLE.plant, Options())


def test_two_columns_that_may_be_meant_are_named():
    two = {"yaw_rate": None, "imu_yaw_rate": np.ones(9), "esp_yaw_rate": np.zeros(9)}
    with pytest.raises(LogError, match="imu_yaw_rate, esp_yaw_rate .*--output-column"):
        found(**two)
    same = found(**two | {"esp_yaw_rate": np.ones(9)})
    assert same.quantities["output"].name == "imu_yaw_rate"
    with pytest.raises(LogError, match="speed, speed_2 .*--measured speed=COLUMN"):
        found(speed=np.ones(9), speed_2=2 * np.ones(9))


def test_words_of_unknown_meaning_are_noted():
    (note,) = found(yaw_rate=None, trailer_yaw_rate=np.zeros(9)).notes
    assert "trailer_yaw_rate was taken as yaw rate" in note


def test_what_was_passed_over_is_noted():
    (note,) = found(imu_yaw_rate=np.zeros(9)).notes
    assert "yaw_rate" in note and "imu_yaw_rate" in note
    (note,) = found(speed=np.full(9, 18.0), gps_speed=np.full(9, 21.6)).notes
    assert "18" in note and "gps_speed 21.6" in note
    assert found(speed=np.full(9, 18.0), gps_speed=np.full(9, 18.1)).notes == ()
