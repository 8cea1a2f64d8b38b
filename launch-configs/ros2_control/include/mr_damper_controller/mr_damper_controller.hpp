// A ros2_control controller around a model that `mr-damper export` wrote as C.
//
//   state interfaces ─────────┐                              ┌──→ state interfaces NAME/force, NAME/validity, ...
//                             ├──→ Readings → Core → Values ─┤
//   reference interfaces ─────┘                              └──→ one command interface (with the inverse controller)
//   (NAME/force_request, ...)
//
// core.hpp has the damper; this class connects it to the interfaces. An update allocates nothing and logs nothing, and tries
// a busy interface a few times instead of waiting for it.
#pragma once

#include <array>
#include <cstddef>
#include <optional>
#include <string>
#include <vector>

#include "controller_interface/chainable_controller_interface.hpp"
#include "mr_damper_controller/core.hpp"
#include "rclcpp/duration.hpp"
#include "rclcpp/time.hpp"
#include "rclcpp_lifecycle/state.hpp"

namespace mr_damper_controller {

class MrDamperController : public controller_interface::ChainableControllerInterface {
 public:
  controller_interface::CallbackReturn on_init() override;
  controller_interface::CallbackReturn on_configure(const rclcpp_lifecycle::State& previous) override;
  controller_interface::CallbackReturn on_activate(const rclcpp_lifecycle::State& previous) override;
  // Marks the estimate as invalid and writes the safe current.
  controller_interface::CallbackReturn on_deactivate(const rclcpp_lifecycle::State& previous) override;

  controller_interface::InterfaceConfiguration command_interface_configuration() const override;
  controller_interface::InterfaceConfiguration state_interface_configuration() const override;

 protected:
  std::vector<hardware_interface::StateInterface::SharedPtr> on_export_state_interfaces_list() override;
  std::vector<hardware_interface::CommandInterface::SharedPtr> on_export_reference_interfaces_list() override;

  // Does nothing: no input comes from a topic.
  controller_interface::return_type update_reference_from_subscribers(
      const rclcpp::Time& time, const rclcpp::Duration& period) override;
  controller_interface::return_type update_and_write_commands(
      const rclcpp::Time& time, const rclcpp::Duration& period) override;

 private:
  // Where the readings of an input come from.
  struct Source {
    std::string state_interface;  // empty: the reference interface
    double sign = 1.0;
    double offset = 0.0;
    std::size_t loaned = 0;  // place in `state_interfaces_`
    hardware_interface::CommandInterface::SharedPtr reference;
  };

  // Reads the parameters. Returns the error, which names parameter and value, or nothing.
  std::optional<std::string> read_parameters();
  std::optional<std::string> read_source(std::size_t input);
  // What forbids activation, or nothing.
  std::optional<std::string> check_interfaces() const;

  // The reading of an input; NaN if none arrived. A reference counts once.
  double take(Source& source);
  // Writes all state interfaces. False if the values before may stand there without a mark.
  bool publish(const Values& values);
  bool command(double current_a);

  Core core_;
  std::array<Source, kInputCount> sources_;
  std::string command_interface_;  // empty: none
  std::array<hardware_interface::StateInterface::SharedPtr, kOutputCount> outputs_;
};

}  // namespace mr_damper_controller
