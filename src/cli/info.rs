//! `cardioid info`: what a scene holds and what would be built for it.

use super::picture::{SceneArgs, describe_camera, load};
use super::settings::SettingsArgs;
use anyhow::Result;
use cardioid::lights::Light;
use cardioid::render::Settings;
use clap::Args;
use std::io::Write;
use std::process::ExitCode;

/// Show what a scene holds, and what would be built for it and why
#[derive(Args, Clone, Debug)]
pub(crate) struct InfoArgs {
    #[command(flatten)]
    scene: SceneArgs,

    #[command(flatten)]
    settings: SettingsArgs,

    /// Print JSON.
    #[arg(long)]
    json: bool,
}

pub(crate) fn run(args: &InfoArgs) -> Result<ExitCode> {
    let loaded = load(&args.scene, &|| ())?;
    let settings = Settings::from(&args.settings.over(&loaded.description.render));
    let scene = &loaded.built.scene;
    let plan = settings.plan(scene);
    let mut out = std::io::stdout().lock();
    if args.json {
        let value = serde_json::json!({ "scene": scene.name(), "settings": settings, "plan": plan });
        writeln!(out, "{}", serde_json::to_string_pretty(&value)?)?;
        return Ok(ExitCode::SUCCESS);
    }
    writeln!(out, "{}", scene.name())?;
    writeln!(out, "  picture    {} x {} pixels", loaded.size.0, loaded.size.1)?;
    writeln!(out, "  camera     {}", describe_camera(loaded.description.camera.as_ref()))?;
    let radius = scene.space().metres(f64::from(scene.bounds().1));
    writeln!(out, "  extent     radius {radius:.4} m around {:.4} m", scene.space().center)?;
    writeln!(out, "  geometry   {}", plan.geometry.join(", "))?;
    let flux_unit = 1.0 / (scene.space().power * scene.space().scale * scene.space().scale);
    for light in scene.lights() {
        let kind = match light {
            Light::Area(_) => "area light",
            Light::Point(_) => "point light",
            Light::Directional(_) => "parallel light",
            Light::Environment(_) => "environment",
        };
        let flux = light.flux(scene.bounds().1) * flux_unit;
        writeln!(out, "  light      {kind}, {:.4} {:.4} {:.4} W", flux.x, flux.y, flux.z)?;
    }
    writeln!(out, "  Embree     {}", loaded.device.version())?;
    writeln!(out, "plan")?;
    for (name, decision) in plan.decisions() {
        writeln!(out, "  {name:24} {decision}")?;
    }
    writeln!(out, "settings")?;
    if let serde_json::Value::Object(values) = serde_json::to_value(&settings)? {
        for (name, value) in values {
            writeln!(out, "  {name:24} {value}")?;
        }
    }
    Ok(ExitCode::SUCCESS)
}
