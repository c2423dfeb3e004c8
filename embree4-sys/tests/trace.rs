//! The library that is loaded is the one the headers belong to, and traces a ray through these bindings.
#![allow(unsafe_code, reason = "calls Embree")]

use std::ptr;

use embree4_sys::*;

#[test]
fn library_is_no_older_than_the_headers() {
    // SAFETY: a null configuration is allowed; the device is released once and not used after.
    let version = unsafe {
        let device = rtcNewDevice(ptr::null());
        assert!(!device.is_null());
        let version = rtcGetDeviceProperty(device, RTC_DEVICE_PROPERTY_VERSION);
        rtcReleaseDevice(device);
        version
    };
    assert!(version >= RTC_VERSION as isize, "library {version}, headers {RTC_VERSION}");
}

#[test]
fn one_ray_hits_one_triangle() {
    const VERTICES: [[f32; 3]; 3] = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
    let mut query = RTCRayHit {
        ray: RTCRay {
            org_x: 0.25,
            org_y: 0.5,
            org_z: 2.0,
            tnear: 0.0,
            dir_x: 0.0,
            dir_y: 0.0,
            dir_z: -1.0,
            time: 0.0,
            tfar: f32::INFINITY,
            mask: u32::MAX,
            id: 0,
            flags: 0,
        },
        hit: RTCHit {
            Ng_x: 0.0,
            Ng_y: 0.0,
            Ng_z: 0.0,
            u: 0.0,
            v: 0.0,
            primID: RTC_INVALID_GEOMETRY_ID,
            geomID: RTC_INVALID_GEOMETRY_ID,
            instID: [RTC_INVALID_GEOMETRY_ID],
            instPrimID: [RTC_INVALID_GEOMETRY_ID],
        },
    };
    // SAFETY: each handle is used before it is released, each buffer is written within its length, and the query and its
    // arguments outlive the call.
    let (geometry_id, error) = unsafe {
        let device = rtcNewDevice(ptr::null());
        assert!(!device.is_null());
        let geometry = rtcNewGeometry(device, RTC_GEOMETRY_TYPE_TRIANGLE);
        let vertices = rtcSetNewGeometryBuffer(
            geometry,
            RTC_BUFFER_TYPE_VERTEX,
            0,
            RTC_FORMAT_FLOAT3,
            12,
            VERTICES.len(),
        );
        vertices.cast::<[f32; 3]>().copy_from_nonoverlapping(VERTICES.as_ptr(), VERTICES.len());
        let indices = rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3, 12, 1);
        indices.cast::<[u32; 3]>().write([0, 1, 2]);
        rtcCommitGeometry(geometry);
        let scene = rtcNewScene(device);
        rtcSetSceneFlags(scene, RTC_SCENE_FLAG_ROBUST | RTC_SCENE_FLAG_COMPACT);
        let geometry_id = rtcAttachGeometry(scene, geometry);
        rtcReleaseGeometry(geometry);
        rtcCommitScene(scene);
        rtcIntersect1(scene, &raw mut query, &mut RTCIntersectArguments::new());
        let error = rtcGetDeviceError(device);
        rtcReleaseScene(scene);
        rtcReleaseDevice(device);
        (geometry_id, error)
    };
    assert_eq!(error, RTC_ERROR_NONE);
    assert_eq!((query.hit.geomID, query.hit.primID), (geometry_id, 0));
    assert_eq!(query.hit.instID, [RTC_INVALID_GEOMETRY_ID]);
    assert!((query.ray.tfar - 2.0).abs() < 1e-6);
    assert!((query.hit.u - 0.25).abs() < 1e-6 && (query.hit.v - 0.5).abs() < 1e-6);
}
