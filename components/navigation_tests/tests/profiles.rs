//! The profiles of the navigation robot say what the compiled classes say, and nothing has drifted.

use std::path::{Path, PathBuf};

use component_sdk::abi::class::{ClassDecl, Direction, TriggerDecl};
use component_sdk::component::Component;
use framework_daemon::profile::load::load;
use framework_daemon::profile::plan::{ComponentPlan, Plan, Trigger, Usage};

/// Library and class of each component.
fn classes() -> [(&'static str, ClassDecl); 9] {
    [
        ("motion_board", motion_board::MotionBoard::DECL),
        ("ultrasonic", ultrasonic::UltrasonicFilter::DECL),
        ("encoder_odometry", encoder_odometry::EncoderOdometry::DECL),
        ("vision_sensor", vision_sensor::VisionSensor::DECL),
        ("object_detector", object_detector::ColourDetector::DECL),
        ("path_planner", path_planner::PathPlanner::DECL),
        ("avoidance_primary", avoidance_primary::AvoidancePrimary::DECL),
        ("avoidance_secondary", avoidance_secondary::AvoidanceSecondary::DECL),
        ("motor_control", motor_control::MotorControl::DECL),
    ]
}

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

fn plan() -> Plan {
    load(&root().join("profiles/navigation")).unwrap_or_else(|findings| panic!("{findings:#?}")).plan
}

/// Every component profile that the application uses, secondaries too.
fn components(plan: &Plan) -> Vec<&ComponentPlan> {
    let secondaries = plan.slots.iter().flat_map(|slot| &slot.rules.secondaries).map(|secondary| &secondary.component);
    plan.slots.iter().map(|slot| &slot.component).chain(secondaries).map(AsRef::as_ref).collect()
}

#[test]
fn the_slots_have_the_names_that_the_demo_knows() {
    let plan = plan();
    let names: Vec<_> = plan.slots.iter().map(|slot| slot.name.as_str()).collect();
    assert_eq!(names, ["board", "sonar", "odometry", "vision", "detector", "planner", "avoider", "motors"]);
    assert_eq!(components(&plan).len(), classes().len(), "every class is used");
}

#[test]
fn profiles_and_classes_agree() {
    let plan = plan();
    for component in components(&plan) {
        let (_, class) = classes()
            .into_iter()
            .find(|(library, class)| component.library == *library && component.name == class.name.as_str())
            .unwrap_or_else(|| panic!("no library {} has a class {}", component.library, component.name));
        assert_eq!(ports_of_profile(component), ports_of_class(&class), "ports of {}", component.name);
        assert_eq!(properties_of_profile(component), properties_of_class(&class), "properties of {}", component.name);
        assert_eq!(component.version, class.version.as_str());
        assert_eq!(component.execution.trigger, trigger(class.trigger), "trigger of {}", component.name);
    }
}

#[test]
fn each_crate_holds_its_profile_and_describes_itself() {
    for (library, class) in classes() {
        let directory = root().join("components").join(library);
        let read = |path: PathBuf| {
            std::fs::read_to_string(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display()))
        };
        let profile = read(root().join(format!("profiles/navigation/{}.xml", class.name)));
        assert_eq!(read(directory.join("profile.xml")), profile, "{library}/profile.xml is not the one in use");
        let readme = read(directory.join("README.md"));
        let names =
            class.ports.iter().map(|port| port.name).chain(class.properties.iter().map(|property| property.name));
        for name in names {
            assert!(readme.contains(&format!("| `{name}` |")), "{library}/README.md does not mention `{name}`");
        }
    }
}

fn ports_of_profile(component: &ComponentPlan) -> Vec<(&str, bool, &str)> {
    let ports = component.data_ports.iter();
    ports.map(|port| (port.name.as_str(), port.usage == Usage::Input, port.data_type.as_str())).collect()
}

fn ports_of_class(class: &ClassDecl) -> Vec<(&str, bool, &str)> {
    let ports = class.ports.as_slice().iter();
    ports.map(|port| (port.name.as_str(), port.direction == Direction::Input, port.object.name.as_str())).collect()
}

fn properties_of_profile(component: &ComponentPlan) -> Vec<(&str, &str, &str)> {
    let properties = component.properties.iter();
    properties.map(|one| (one.name.as_str(), one.type_name.as_str(), one.value.as_str())).collect()
}

fn properties_of_class(class: &ClassDecl) -> Vec<(&str, &str, &str)> {
    let properties = class.properties.as_slice().iter();
    properties.map(|one| (one.name.as_str(), one.kind.opros_name(), one.default.as_str())).collect()
}

fn trigger(class: TriggerDecl) -> Trigger {
    match class {
        TriggerDecl::Periodic { period_ns } => Trigger::Periodic(std::time::Duration::from_nanos(period_ns)),
        TriggerDecl::Nonperiodic => Trigger::Nonperiodic,
        TriggerDecl::Passive => Trigger::Passive,
    }
}
