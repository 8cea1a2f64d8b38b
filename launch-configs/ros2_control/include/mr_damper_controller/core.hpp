// One damper, sample by sample: readings in, one step of the exported model, values of the state interfaces out.
//
//   readings (NaN: none arrived) ──→ model::Input ──→ NAME_step ──→ model::Output ──→ values
//
// No ROS, no clock, no allocation, no lock. Which inputs and outputs exist depends on the exported files: the compiler looks at their
// structures. Tested by test/core_test.cpp, which needs a C++17 compiler only.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <type_traits>

#include "mr_damper_controller/model.hpp"

namespace mr_damper_controller {

// True if the exported structure has the member.
#define MR_DAMPER_HAS(member)                                  \
  template <typename T, typename = void>                       \
  struct has_##member : std::false_type {};                    \
  template <typename T>                                        \
  struct has_##member<T, std::void_t<decltype(T::member)>> : std::true_type {}
MR_DAMPER_HAS(current_a);
MR_DAMPER_HAS(command_v);
MR_DAMPER_HAS(velocity_m_s);
MR_DAMPER_HAS(case_temp_c);
MR_DAMPER_HAS(force_request_n);
#undef MR_DAMPER_HAS

inline constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

// An input or output of the controller, and the name of its interface.
struct Channel {
  const char* name;
  const char* about;    // meaning and unit
  bool exists;          // in the exported model
};

// Inputs, in the order of `Readings`.
enum InputId : std::size_t { kDisplacement, kCurrent, kVoltage, kVelocity, kCaseTemperature, kForceRequest, kInputCount };

// Readings of one sample in SI units; NaN: none arrived.
using Readings = std::array<double, kInputCount>;

inline constexpr bool kHasInverse = has_force_request_n<model::Input>::value;

inline constexpr std::array<Channel, kInputCount> kInputs{{
    {"displacement", "displacement, positive in extension, m", true},
    {"current", "coil current, A", has_current_a<model::Input>::value},
    {"voltage", "command voltage of the driver, V", has_command_v<model::Input>::value},
    {"velocity", "measured velocity, positive in extension, m/s", has_velocity_m_s<model::Input>::value},
    {"case_temperature", "temperature of the damper's case, degrees Celsius", has_case_temp_c<model::Input>::value},
    {"force_request", "demanded force, positive in extension (tension), N", kHasInverse},
}};

// Outputs, in the order of `Values`.
enum OutputId : std::size_t {
  kForce,
  kForceReading,
  kVelocityUsed,
  kValidity,
  kMode,
  kReasons,
  kCurrentCommand,
  kForceRequested,
  kForceExpected,
  kForceLeast,
  kForceMost,
  kLimitedBy,
  kOutputCount
};

// Values of the state interfaces after one sample.
using Values = std::array<double, kOutputCount>;

inline constexpr std::array<Channel, kOutputCount> kOutputs{{
    {"force", "estimated force of the damper, positive in extension (tension), N; NaN without an estimate", true},
    {"force_reading", "what a load cell should show, N; NaN without an estimate", true},
    {"velocity", "velocity that the model was given, m/s; NaN without an estimate", true},
    {"validity", "a VALIDITY constant of mr_damper_msgs/msg/ForceEstimate", true},
    {"mode", "MODE_MODEL (2) with a force, MODE_FAULT (4) without", true},
    {"reasons", "REASON bits of mr_damper_msgs/msg/ForceEstimate", true},
    {"current_command", "commanded current, A; always finite, within the exported limits", kHasInverse},
    {"force_requested", "demanded force that holds now, N; NaN without one", kHasInverse},
    {"force_expected", "force that the model expects at the commanded current, N; NaN if unknown", kHasInverse},
    {"force_least", "least force of the damper at this motion, N; NaN if unknown", kHasInverse},
    {"force_most", "largest force of the damper at this motion, N; NaN if unknown", kHasInverse},
    {"limited_by", "why the command does not reach the demanded force: NAME_LIMITED_BY of the exported header", kHasInverse},
}};

// Constants of mr_damper_msgs/msg/ForceEstimate.
enum Validity : std::uint8_t { kValid = 0, kDegraded = 1, kIsExtrapolating = 2, kIsStale = 3, kIsInvalid = 4 };
enum Mode : std::uint8_t { kModeModel = 2, kModeFault = 4 };

// How far an estimate with these flags can be trusted: the worst of them counts, as in the service. Every other flag degrades.
inline Validity validity_of(std::uint32_t flags, double force_n) {
  if (std::isnan(force_n) || (flags & model::kInvalid) != 0U) return kIsInvalid;
  if ((flags & model::kStale) != 0U) return kIsStale;
  if ((flags & model::kExtrapolating) != 0U) return kIsExtrapolating;
  return flags != 0U ? kDegraded : kValid;
}

// Takes its types as parameters, so that code for members that do not exist is not compiled.
template <typename Parameters, typename State, typename Input, typename Output>
class BasicCore {
 public:
  // Puts the damper at rest, and forgets the demanded force.
  void reset() noexcept { model::reset(state_); }

  // One sample at `time_ns`. The clock may be any that increases; a repeated time is refused, as is one that goes back.
  Values update(std::int64_t time_ns, const Readings& readings) noexcept {
    Input input{};
    input.time_ns = time_ns;
    input.displacement_m = readings[kDisplacement];
    if constexpr (has_current_a<Input>::value) input.current_a = readings[kCurrent];
    if constexpr (has_command_v<Input>::value) input.command_v = readings[kVoltage];
    if constexpr (has_velocity_m_s<Input>::value) input.velocity_m_s = readings[kVelocity];
    if constexpr (has_case_temp_c<Input>::value) input.case_temp_c = readings[kCaseTemperature];
    if constexpr (has_force_request_n<Input>::value) input.force_request_n = readings[kForceRequest];
    Output output{};
    const bool is_accepted = model::step(model::default_parameters(), state_, input, output);
    const double force_n = is_accepted ? output.force_n : kNaN;

    Values values = without_estimate();
    values[kReasons] = output.flags;
    values[kForce] = force_n;
    values[kForceReading] = is_accepted ? output.reading_n : kNaN;
    values[kVelocityUsed] = is_accepted ? output.velocity_m_s : kNaN;
    values[kValidity] = validity_of(output.flags, force_n);
    values[kMode] = std::isnan(force_n) ? kModeFault : kModeModel;
    if constexpr (has_force_request_n<Input>::value) {
      // Without a command the current before holds, and goes to the safe one if displacements stay away.
      values[kCurrentCommand] = is_accepted ? output.current_a : model::silent_current_a(state_, time_ns);
      values[kForceRequested] = output.requested_n;
      values[kForceExpected] = output.expected_n;
      values[kForceLeast] = output.achievable_n[0];
      values[kForceMost] = output.achievable_n[1];
      values[kLimitedBy] = output.limited_by;
    }
    return values;
  }

  // Values while the controller does not run: no estimate, and the safe current.
  static Values without_estimate() noexcept {
    Values values{};
    values.fill(kNaN);
    values[kValidity] = kIsInvalid;
    values[kMode] = kModeFault;
    values[kReasons] = 0.0;
    values[kCurrentCommand] = safe_current_a(model::default_parameters());
    values[kLimitedBy] = 0.0;
    return values;
  }

 private:
  template <typename P>
  static double safe_current_a([[maybe_unused]] const P& parameters) noexcept {
    if constexpr (has_force_request_n<Input>::value) {
      return std::clamp(parameters.inverse_safe_a, 0.0, parameters.inverse_current_max_a);
    } else {
      return kNaN;
    }
  }

  State state_{};
};

using Core = BasicCore<model::Parameters, model::State, model::Input, model::Output>;

}  // namespace mr_damper_controller
