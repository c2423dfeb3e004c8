//! Keys and types that other renderers name differently, so that a message can give the name used here.

/// Names in other renderers, in lower case with dashes, and the names used here. The first one that is valid at the place is
/// meant.
const SYNONYMS: &[(&str, &[&str])] = &[
    // Materials.
    ("color", &["colour", "reflectance", "diffuse", "radiance", "irradiance", "intensity"]),
    ("colour", &["reflectance", "diffuse", "radiance", "irradiance", "intensity"]),
    ("rgb", &["colour", "reflectance", "diffuse", "radiance", "irradiance", "intensity"]),
    ("albedo", &["reflectance", "colour", "diffuse"]),
    ("base-color", &["reflectance", "colour", "diffuse"]),
    ("basecolor", &["reflectance", "colour", "diffuse"]),
    ("diffuse", &["reflectance", "colour", "lambert"]),
    ("diffuse-color", &["reflectance", "diffuse", "colour"]),
    ("kd", &["reflectance", "diffuse", "colour"]),
    ("ks", &["specular", "reflectance", "colour"]),
    ("index-of-refraction", &["ior", "eta"]),
    ("refractive-index", &["ior", "eta"]),
    ("eta", &["ior"]),
    ("shininess", &["roughness"]),
    ("glossiness", &["roughness"]),
    ("smoothness", &["roughness"]),
    ("glass", &["dielectric"]),
    ("water", &["dielectric"]),
    ("matte", &["lambert"]),
    ("metal", &["conductor", "mirror"]),
    ("chrome", &["mirror", "conductor"]),
    ("plastic", &["ward"]),
    ("glossy", &["ward"]),
    ("phong", &["ward"]),
    // Light.
    ("emissive", &["emission"]),
    ("emit", &["emission"]),
    ("strength", &["power", "intensity", "radiance", "irradiance", "scale"]),
    ("brightness", &["power", "intensity", "radiance", "irradiance", "scale"]),
    ("energy", &["power", "intensity", "radiance", "irradiance", "scale"]),
    ("watts", &["power", "intensity", "radiance", "irradiance"]),
    ("intensity", &["radiance", "irradiance", "scale"]),
    ("sun", &["directional", "sky"]),
    ("hdri", &["environment", "image"]),
    ("cone-angle", &["outer-angle"]),
    // Placement and shapes.
    ("location", &["position", "eye", "center", "corner"]),
    ("origin", &["eye", "position", "center", "corner"]),
    ("translate", &["transform"]),
    ("translation", &["transform"]),
    ("rotate", &["transform"]),
    ("scale", &["transform"]),
    ("look-at", &["at"]),
    ("lookat", &["at"]),
    ("target", &["at"]),
    ("field-of-view", &["fov"]),
    ("angle", &["fov", "outer-angle"]),
    ("path", &["file"]),
    ("filename", &["file"]),
    ("cube", &["box"]),
    ("plane", &["quad"]),
    ("rectangle", &["quad"]),
    ("circle", &["disc"]),
    ("disk", &["disc"]),
    ("tube", &["cylinder"]),
    ("ply", &["mesh"]),
    ("obj", &["mesh"]),
    ("stl", &["mesh"]),
    ("model", &["mesh", "file"]),
    // Tables and settings.
    ("objects", &["shapes"]),
    ("geometry", &["shapes"]),
    ("settings", &["render"]),
    ("options", &["render"]),
    ("image", &["film"]),
    ("output", &["film"]),
    ("resolution", &["width"]),
    ("size", &["width", "radius"]),
    ("samples", &["spp"]),
    ("photons", &["global-photons"]),
    ("bounces", &["max-depth"]),
    ("depth", &["max-depth"]),
];

/// The name in `known` that other renderers call `name`, if there is one.
pub(super) fn synonym<'a>(name: &str, known: impl IntoIterator<Item = &'a str>) -> Option<&'a str> {
    /// No synonym is longer.
    const LONGEST: usize = 32;
    if name.len() > LONGEST {
        return None;
    }
    let plain = name.to_ascii_lowercase().replace('_', "-");
    let (_, ours) = SYNONYMS.iter().find(|(other, _)| *other == plain)?;
    let rank = |name: &str| ours.iter().position(|own| *own == name);
    known.into_iter().filter_map(|name| Some((rank(name)?, name))).min().map(|(_, name)| name)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_of_others_are_known_where_they_mean_something() {
        let lambert = ["type", "reflectance", "two-sided"];
        for name in ["color", "colour", "Albedo", "base_color", "Kd", "diffuse"] {
            assert_eq!(synonym(name, lambert), Some("reflectance"), "{name}");
        }
        assert_eq!(synonym("color", ["roughness", "reflectance", "colour"]), Some("colour"));
        assert_eq!(synonym("glass", ["lambert", "dielectric"]), Some("dielectric"));
        assert_eq!(synonym("zebra", lambert), None);
        assert_eq!(synonym("glass", lambert), None);
    }

    /// No name occurs twice, and none maps to itself.
    #[test]
    fn each_name_has_one_line() {
        let mut names: Vec<&str> = SYNONYMS.iter().map(|(name, _)| *name).collect();
        let count = names.len();
        names.sort_unstable();
        names.dedup();
        assert_eq!(names.len(), count);
        assert!(SYNONYMS.iter().all(|(name, ours)| !ours.contains(name)));
    }
}
