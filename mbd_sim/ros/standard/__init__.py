"""Services and actions of packages that simulators and planners share: `simulation_interfaces`, `moveit_msgs`."""
