#include "mr_damper_controller/mr_damper_controller.hpp"

#include <cmath>
#include <memory>
#include <set>
#include <stdexcept>

#include "hardware_interface/handle.hpp"
#include "pluginlib/class_list_macros.hpp"
#include "rcl_interfaces/msg/parameter_descriptor.hpp"
#include "rclcpp/logging.hpp"

namespace mr_damper_controller {

using controller_interface::CallbackReturn;
using controller_interface::return_type;

namespace {

constexpr const char* kCommandParameter = "current_command.command_interface";
// A handle is busy only while another thread copies one number.
constexpr int kTries = 10;

bool has_direction(std::size_t input) { return input == kDisplacement || input == kVelocity; }

std::string parameter(std::size_t input, const char* field) { return std::string(kInputs[input].name) + "." + field; }

rcl_interfaces::msg::ParameterDescriptor described(const std::string& about) {
  rcl_interfaces::msg::ParameterDescriptor descriptor;
  descriptor.description = about + ". Takes effect when the controller is configured.";
  return descriptor;
}

// COMPONENT/INTERFACE, with a name on both sides of the last slash.
bool is_interface_name(const std::string& name) {
  const auto slash = name.rfind('/');
  return slash != std::string::npos && slash > 0 && slash + 1 < name.size();
}

std::optional<std::string> wrong_name(const std::string& parameter, const std::string& name) {
  if (name.empty() || is_interface_name(name)) return std::nullopt;
  return "parameter '" + parameter + "' is '" + name + "', which is not of the form JOINT/INTERFACE, for example 'front_left/position'";
}

// Declares a sign; throws an error with the value that was given.
void declare_sign(rclcpp_lifecycle::LifecycleNode& node, const std::string& name) {
  auto descriptor = described("1 if the interface is positive in extension of the damper, -1 if in compression");
  descriptor.integer_range.resize(1);
  descriptor.integer_range[0].from_value = -1;
  descriptor.integer_range[0].to_value = 1;
  descriptor.integer_range[0].step = 2;
  try {
    node.declare_parameter<std::int64_t>(name, 1, descriptor);
  } catch (const rclcpp::exceptions::InvalidParameterValueException&) {
    const auto& overrides = node.get_node_parameters_interface()->get_parameter_overrides();
    const auto given = overrides.find(name);
    throw std::invalid_argument("parameter '" + name + "' is " + (given == overrides.end() ? "?" : rclcpp::to_string(given->second)) +
                                "; set it to 1 or -1");
  }
}

bool set(hardware_interface::Handle& handle, double value) {
  for (int tries = 0; tries < kTries; ++tries) {
    if (handle.set_value(value)) return true;
  }
  return false;
}

}  // namespace

CallbackReturn MrDamperController::on_init() {
  try {
    for (std::size_t input = 0; input < kInputCount; ++input) {
      if (!kInputs[input].exists) continue;
      const std::string about = kInputs[input].about;
      get_node()->declare_parameter<std::string>(
          parameter(input, "state_interface"), "",
          described("State interface with the " + about + "; empty: the reference interface '" + kInputs[input].name +
                    "' of this controller, which a preceding controller writes"));
      if (!has_direction(input)) continue;
      declare_sign(*get_node(), parameter(input, "sign"));
      if (input != kDisplacement) continue;
      get_node()->declare_parameter<double>(
          parameter(input, "offset_m"), 0.0,
          described("Value of the interface where the model's displacement is zero, m: displacement = sign * (value - offset_m)"));
    }
    if (kHasInverse) {
      get_node()->declare_parameter<std::string>(
          kCommandParameter, "",
          described("Command interface that gets the coil current, A, for example 'front_left/current'; empty: no current is commanded"));
    }
  } catch (const std::exception& error) {
    RCLCPP_ERROR(get_node()->get_logger(), "%s", error.what());
    return CallbackReturn::ERROR;
  }
  return CallbackReturn::SUCCESS;
}

std::optional<std::string> MrDamperController::read_source(std::size_t input) {
  Source& source = sources_[input];
  source = Source{};
  const std::string name = parameter(input, "state_interface");
  source.state_interface = get_node()->get_parameter(name).as_string();
  if (auto error = wrong_name(name, source.state_interface)) return error;
  if (has_direction(input)) {
    source.sign = static_cast<double>(get_node()->get_parameter(parameter(input, "sign")).as_int());
  }
  if (input == kDisplacement) {
    const std::string offset = parameter(input, "offset_m");
    source.offset = get_node()->get_parameter(offset).as_double();
    if (!std::isfinite(source.offset)) {
      return "parameter '" + offset + "' is " + std::to_string(source.offset) + "; set a finite number of metres";
    }
  }
  return std::nullopt;
}

std::optional<std::string> MrDamperController::read_parameters() {
  std::set<std::string> seen;
  std::size_t loaned = 0;
  for (std::size_t input = 0; input < kInputCount; ++input) {
    if (!kInputs[input].exists) continue;
    if (auto error = read_source(input)) return error;
    Source& source = sources_[input];
    if (source.state_interface.empty()) continue;
    if (!seen.insert(source.state_interface).second) {
      return "parameter '" + parameter(input, "state_interface") + "' is '" + source.state_interface +
             "', which is already the interface of another input; each input needs its own";
    }
    source.loaned = loaned++;
  }
  command_interface_ = kHasInverse ? get_node()->get_parameter(kCommandParameter).as_string() : "";
  return wrong_name(kCommandParameter, command_interface_);
}

CallbackReturn MrDamperController::on_configure(const rclcpp_lifecycle::State&) {
  if (const auto error = read_parameters()) {
    RCLCPP_ERROR(get_node()->get_logger(), "%s", error->c_str());
    return CallbackReturn::FAILURE;
  }
  return CallbackReturn::SUCCESS;
}

controller_interface::InterfaceConfiguration MrDamperController::state_interface_configuration() const {
  controller_interface::InterfaceConfiguration configuration;
  for (const Source& source : sources_) {
    if (!source.state_interface.empty()) configuration.names.push_back(source.state_interface);
  }
  if (!configuration.names.empty()) configuration.type = controller_interface::interface_configuration_type::INDIVIDUAL;
  return configuration;
}

controller_interface::InterfaceConfiguration MrDamperController::command_interface_configuration() const {
  controller_interface::InterfaceConfiguration configuration;
  if (!command_interface_.empty()) {
    configuration.type = controller_interface::interface_configuration_type::INDIVIDUAL;
    configuration.names.push_back(command_interface_);
  }
  return configuration;
}

std::vector<hardware_interface::StateInterface::SharedPtr> MrDamperController::on_export_state_interfaces_list() {
  std::vector<hardware_interface::StateInterface::SharedPtr> all;
  for (std::size_t output = 0; output < kOutputCount; ++output) {
    if (!kOutputs[output].exists) continue;
    outputs_[output] = std::make_shared<hardware_interface::StateInterface>(get_node()->get_name(), kOutputs[output].name);
    all.push_back(outputs_[output]);
  }
  publish(Core::without_estimate());
  return all;
}

std::vector<hardware_interface::CommandInterface::SharedPtr> MrDamperController::on_export_reference_interfaces_list() {
  std::vector<hardware_interface::CommandInterface::SharedPtr> all;
  for (std::size_t input = 0; input < kInputCount; ++input) {
    Source& source = sources_[input];
    if (!kInputs[input].exists || !source.state_interface.empty()) continue;
    // Its value is NaN: nothing has arrived.
    source.reference = std::make_shared<hardware_interface::CommandInterface>(get_node()->get_name(), kInputs[input].name);
    all.push_back(source.reference);
  }
  return all;
}

std::optional<std::string> MrDamperController::check_interfaces() const {
  for (std::size_t input = 0; input < kInputCount; ++input) {
    const Source& source = sources_[input];
    if (!kInputs[input].exists) continue;
    const std::string name = parameter(input, "state_interface");
    if (source.state_interface.empty()) {
      // Nobody needs to demand a force unless a current is commanded.
      const bool is_needed = input != kForceRequest || !command_interface_.empty();
      if (is_needed && !is_in_chained_mode()) {
        return "parameter '" + name + "' is empty, and no active controller precedes this one to write its reference interface '" +
               kInputs[input].name + "'; name a state interface, or activate the preceding controller together with this one";
      }
      continue;
    }
    if (source.loaned >= state_interfaces_.size() || state_interfaces_[source.loaned].get_name() != source.state_interface) {
      return "parameter '" + name + "' is '" + source.state_interface + "', which the controller manager did not provide";
    }
    if (state_interfaces_[source.loaned].get_data_type() != hardware_interface::HandleDataType::DOUBLE) {
      return "parameter '" + name + "' is '" + source.state_interface + "', which is not of type double; name one that is";
    }
  }
  if (command_interface_.empty()) return std::nullopt;
  if (command_interfaces_.size() != 1 || command_interfaces_[0].get_name() != command_interface_) {
    return std::string("parameter '") + kCommandParameter + "' is '" + command_interface_ +
           "', which the controller manager did not provide";
  }
  if (command_interfaces_[0].get_data_type() != hardware_interface::HandleDataType::DOUBLE) {
    return std::string("parameter '") + kCommandParameter + "' is '" + command_interface_ +
           "', which is not of type double; name one that is";
  }
  return std::nullopt;
}

CallbackReturn MrDamperController::on_activate(const rclcpp_lifecycle::State&) {
  if (const auto error = check_interfaces()) {
    RCLCPP_ERROR(get_node()->get_logger(), "%s", error->c_str());
    return CallbackReturn::FAILURE;
  }
  core_.reset();
  for (Source& source : sources_) {
    if (source.reference && !set(*source.reference, kNaN)) return CallbackReturn::ERROR;
  }
  const Values values = Core::without_estimate();
  return publish(values) && command(values[kCurrentCommand]) ? CallbackReturn::SUCCESS : CallbackReturn::ERROR;
}

CallbackReturn MrDamperController::on_deactivate(const rclcpp_lifecycle::State&) {
  const Values values = Core::without_estimate();
  const bool is_marked = publish(values);
  const bool is_safe = command(values[kCurrentCommand]);
  return is_marked && is_safe ? CallbackReturn::SUCCESS : CallbackReturn::ERROR;
}

return_type MrDamperController::update_reference_from_subscribers(const rclcpp::Time&, const rclcpp::Duration&) {
  return return_type::OK;
}

return_type MrDamperController::update_and_write_commands(const rclcpp::Time& time, const rclcpp::Duration&) {
  Readings readings;
  for (std::size_t input = 0; input < kInputCount; ++input) {
    readings[input] = kInputs[input].exists ? take(sources_[input]) : kNaN;
  }
  const Values values = core_.update(time.nanoseconds(), readings);
  const bool is_marked = publish(values);
  const bool is_commanded = command(values[kCurrentCommand]);
  return is_marked && is_commanded ? return_type::OK : return_type::ERROR;
}

double MrDamperController::take(Source& source) {
  double value = kNaN;
  if (!source.state_interface.empty()) {
    value = state_interfaces_[source.loaned].get_optional<double>().value_or(kNaN);
  } else if (source.reference) {
    value = source.reference->get_optional<double>().value_or(kNaN);
    // A preceding controller that stops must not look like one that repeats its value.
    if (!set(*source.reference, kNaN)) value = kNaN;
  }
  return source.sign * (value - source.offset);
}

bool MrDamperController::publish(const Values& values) {
  // While the validity says that there is no estimate, nobody uses values that belong to different samples.
  if (!set(*outputs_[kValidity], kIsInvalid)) return false;
  bool is_complete = true;
  for (std::size_t output = 0; output < kOutputCount; ++output) {
    if (kOutputs[output].exists && output != kValidity) is_complete &= set(*outputs_[output], values[output]);
  }
  // If it fails, the estimate stays marked as invalid until the next update.
  if (is_complete) (void)set(*outputs_[kValidity], values[kValidity]);
  return true;
}

bool MrDamperController::command(double current_a) {
  return command_interface_.empty() || command_interfaces_[0].set_value(current_a);
}

}  // namespace mr_damper_controller

PLUGINLIB_EXPORT_CLASS(mr_damper_controller::MrDamperController, controller_interface::ChainableControllerInterface)
