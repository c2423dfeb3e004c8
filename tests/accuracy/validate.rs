//! The suite of closed forms that `cardioid validate` runs, as a test.

use cardioid::embree::Device;
use cardioid::measure::validate::{ValidateError, validate};
use cardioid::render::{Observer, Silent};
use std::sync::Arc;

#[test]
fn every_closed_form_holds() {
    let device = Arc::new(Device::new(0).unwrap());
    let validation = validate(&device, 16, &Silent).unwrap();
    println!("{}", validation.to_markdown());
    let failures: Vec<_> = validation.failures().collect();
    assert!(failures.is_empty(), "{failures:#?}");
    assert!(validation.rows.len() > 100, "rows are missing: {}", validation.rows.len());
}

struct Hasty;

impl Observer for Hasty {
    fn begin(&self, _: &str, _: u64) {}
    fn advance(&self, _: u64) {}
    fn should_stop(&self) -> bool {
        true
    }
}

#[test]
fn it_stops_when_asked_and_wants_two_seeds() {
    let device = Arc::new(Device::new(0).unwrap());
    assert!(matches!(validate(&device, 16, &Hasty), Err(ValidateError::Stopped)));
    assert!(matches!(validate(&device, 1, &Silent), Err(ValidateError::Seeds(1))));
}
