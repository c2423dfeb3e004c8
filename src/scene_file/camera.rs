//! Cameras as scene files give them.

use super::description::Location;
use crate::camera::{Camera, Lens};
use crate::scene::RenderSpace;
use glam::DVec3;

/// Side of the picture that an extent spans.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum FovAxis {
    /// From the lower to the upper edge.
    Vertical,
    /// From the left to the right edge.
    Horizontal,
    /// The width of a sensor of this width over its height, of which the picture shows the largest part of its own aspect.
    Sensor {
        /// Width over height.
        aspect: f64,
    },
}

impl FovAxis {
    /// The height of a picture of `width` by `height` square pixels on a plane, from its extent along this axis.
    fn height(self, extent: f64, (width, height): (u32, u32)) -> f64 {
        let ratio = f64::from(height) / f64::from(width);
        match self {
            Self::Vertical => extent,
            Self::Horizontal => extent * f64::from(height) / f64::from(width),
            Self::Sensor { aspect } if ratio * aspect > 1.0 => extent / aspect,
            Self::Sensor { .. } => extent * ratio,
        }
    }
}

/// What a camera sees. Extents are kept as the file gives them, because the command line may change the aspect of the picture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ProjectionDescription {
    /// Rays through one point, or a lens.
    Perspective {
        /// Full field of view along `axis`, degrees, in `(0, 180)`.
        fov: f64,
        /// Side that `fov` spans.
        axis: FovAxis,
    },
    /// Parallel rays.
    Orthographic {
        /// What is in view along `axis`, metres, above 0.
        extent: f64,
        /// Side that `extent` spans.
        axis: FovAxis,
    },
    /// All directions, by their angle around `up` and above the horizon.
    Panorama,
    /// An equidistant fisheye.
    Fisheye {
        /// Full angle of its disc, degrees, above 0, at most 360.
        angle: f64,
    },
}

/// A camera with or without a lens.
#[derive(Clone, Debug)]
pub struct CameraDescription {
    /// Where it is defined.
    pub location: Location,
    /// Position, metres. Of parallel rays: the middle of the plane on which they start.
    pub eye: DVec3,
    /// Point at the centre of the picture, metres. Of a panorama: at its middle column.
    pub at: DVec3,
    /// A direction that points up in the picture.
    pub up: DVec3,
    /// What it sees.
    pub projection: ProjectionDescription,
    /// The lens; none for a pinhole.
    pub lens: Option<LensDescription>,
    /// Whether the picture is mirrored left to right.
    pub mirrored: bool,
}

/// A thin lens.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LensDescription {
    /// Radius, metres.
    pub radius: f64,
    /// Distance of the sharp plane from the eye, along the view, metres.
    pub focus: f64,
}

impl CameraDescription {
    /// The field of view, degrees, and the side that it spans; `None` for other cameras.
    pub fn perspective(&self) -> Option<(f64, FovAxis)> {
        match self.projection {
            ProjectionDescription::Perspective { fov, axis } => Some((fov, axis)),
            _ => None,
        }
    }

    /// Full vertical field of view in degrees of a picture of `width` by `height` square pixels; `None` where rays do not start at one
    /// point or the picture is not on a plane.
    pub fn vertical_fov(&self, width: u32, height: u32) -> Option<f64> {
        match self.projection {
            ProjectionDescription::Perspective { fov, axis: FovAxis::Vertical } => Some(fov),
            ProjectionDescription::Perspective { fov, axis } => {
                let half = (0.5 * fov).to_radians().tan();
                Some((2.0 * axis.height(half, (width, height)).atan()).to_degrees())
            }
            _ => None,
        }
    }

    /// The camera for a picture of `width` by `height` pixels in render space; `None` where it has no view: `eye` and `at` coincide, or
    /// `up` is parallel to the view.
    pub fn build(&self, space: &RenderSpace, (width, height): (u32, u32)) -> Option<Camera> {
        let aspect = f64::from(width) / f64::from(height);
        let (eye, at, up) = (space.position(self.eye), space.position(self.at), self.up);
        let camera = match self.projection {
            ProjectionDescription::Perspective { .. } => {
                Camera::look_at(eye, at, up, self.vertical_fov(width, height)?, aspect)?
            }
            ProjectionDescription::Orthographic { extent, axis } => {
                let tall = space.length(axis.height(extent, (width, height)));
                Camera::orthographic(eye, at, up, tall, aspect)?
            }
            ProjectionDescription::Panorama => Camera::equirectangular(eye, at, up, aspect)?,
            ProjectionDescription::Fisheye { angle } => Camera::fisheye(eye, at, up, angle, aspect)?,
        };
        let camera = if self.mirrored { camera.mirrored() } else { camera };
        Some(match self.lens {
            Some(lens) => {
                camera.with_lens(Lens { radius: space.length(lens.radius), focus: space.length(lens.focus) })
            }
            None => camera,
        })
    }

    /// The view in words: what the projection is, and how much of the scene it shows.
    pub fn describe_projection(&self) -> String {
        let side = |axis: FovAxis| match axis {
            FovAxis::Vertical => "vertical",
            FovAxis::Horizontal => "horizontal",
            FovAxis::Sensor { .. } => "across the sensor",
        };
        match self.projection {
            ProjectionDescription::Perspective { fov, axis } => format!("{fov:.2} degrees {}", side(axis)),
            ProjectionDescription::Orthographic { extent, axis } => {
                format!("orthographic, {extent:.4} m {}", side(axis))
            }
            ProjectionDescription::Panorama => "panorama".to_owned(),
            ProjectionDescription::Fisheye { angle } => format!("fisheye of {angle:.2} degrees"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn camera(projection: ProjectionDescription) -> CameraDescription {
        CameraDescription {
            location: Location::default(),
            eye: DVec3::Z,
            at: DVec3::ZERO,
            up: DVec3::Y,
            projection,
            lens: None,
            mirrored: false,
        }
    }

    #[test]
    fn horizontal_field_of_view_follows_the_picture() {
        let camera = camera(ProjectionDescription::Perspective { fov: 90.0, axis: FovAxis::Horizontal });
        assert!((camera.vertical_fov(100, 100).unwrap() - 90.0).abs() < 1e-12);
        assert!((camera.vertical_fov(200, 100).unwrap() - 2.0 * 0.5f64.atan().to_degrees()).abs() < 1e-12);
    }

    /// Half the height of the picture at distance 1, on 36 x 24 mm behind 50 mm: a wider picture spans 36 mm, a taller one 24 mm.
    #[test]
    fn a_sensor_holds_the_picture() {
        let fov = (2.0 * (18.0f64 / 50.0).atan()).to_degrees();
        let camera =
            camera(ProjectionDescription::Perspective { fov, axis: FovAxis::Sensor { aspect: 1.5 } });
        let half = |width, height| (0.5 * camera.vertical_fov(width, height).unwrap()).to_radians().tan();
        for (size, want) in [
            ((300, 200), 12.0 / 50.0),
            ((200, 200), 12.0 / 50.0),
            ((100, 200), 12.0 / 50.0),
            ((400, 200), 9.0 / 50.0),
        ] {
            assert!((half(size.0, size.1) - want).abs() < 1e-12, "{size:?}");
        }
    }
}
