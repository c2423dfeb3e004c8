//! Everything that crosses the border to Embree lies in memory as the C compiler would lay it, and what is written by
//! hand in Rust agrees with the headers' macros and inline functions. The C side is `layout.c`.
#![allow(unsafe_code, reason = "calls C")]

use std::collections::BTreeMap;
use std::ffi::{CStr, c_char, c_uint};
use std::mem::MaybeUninit;

use embree4_sys::*;

#[repr(C)]
struct Entry {
    record: *const c_char,
    field: *const c_char,
    size: usize,
    offset_or_alignment: usize,
}

#[link(name = "embree4_sys_layout", kind = "static")]
unsafe extern "C" {
    fn embree4_sys_layout(count: *mut usize) -> *const Entry;
    safe fn embree4_sys_invalid_geometry_id() -> c_uint;
    fn embree4_sys_init_context(context: *mut RTCRayQueryContext);
    fn embree4_sys_init_intersect(arguments: *mut RTCIntersectArguments);
    fn embree4_sys_init_occluded(arguments: *mut RTCOccludedArguments);
}

/// Size, and offset (of a field) or alignment (of a struct), by `struct` or `struct.field`.
type Layout = BTreeMap<String, (usize, usize)>;

fn c_layout() -> Layout {
    let mut count = 0;
    // SAFETY: the function writes the length of the static table that it returns.
    let entries = unsafe {
        let entries = embree4_sys_layout(&raw mut count);
        std::slice::from_raw_parts(entries, count)
    };
    // SAFETY: the table's strings are literals, or null where there is no field.
    let text = |s: *const c_char| unsafe { CStr::from_ptr(s) }.to_str().expect("ASCII").to_owned();
    entries
        .iter()
        .map(|entry| {
            let mut name = text(entry.record);
            if !entry.field.is_null() {
                name = format!("{name}.{}", text(entry.field));
            }
            (name, (entry.size, entry.offset_or_alignment))
        })
        .collect()
}

/// Size of the field that a function from struct to field would return.
const fn size_of_field<S, F>(_: fn(&S) -> &F) -> usize {
    size_of::<F>()
}

macro_rules! layout {
    ($($record:ident { $($field:ident),* $(,)? })*) => {{
        let mut layout = Layout::new();
        $(
            layout.insert(stringify!($record).to_owned(), (size_of::<$record>(), align_of::<$record>()));
            $(
                layout.insert(
                    concat!(stringify!($record), ".", stringify!($field)).to_owned(),
                    (size_of_field(|s: &$record| &s.$field), std::mem::offset_of!($record, $field)),
                );
            )*
            // Refuses a table that misses a field.
            let _ = |s: $record| { let $record { $($field: _),* } = s; };
        )*
        layout
    }};
}

#[test]
fn rust_lays_structs_out_as_c_does() {
    let rust = layout! {
        RTCRay { org_x, org_y, org_z, tnear, dir_x, dir_y, dir_z, time, tfar, mask, id, flags }
        RTCHit { Ng_x, Ng_y, Ng_z, u, v, primID, geomID, instID, instPrimID }
        RTCRayHit { ray, hit }
        RTCRayQueryContext { instID, instPrimID }
        RTCIntersectArguments { flags, feature_mask, context, filter, intersect }
        RTCOccludedArguments { flags, feature_mask, context, filter, occluded }
        RTCBounds { lower_x, lower_y, lower_z, align0, upper_x, upper_y, upper_z, align1 }
        RTCBoundsFunctionArguments { geometryUserPtr, primID, timeStep, bounds_o }
        RTCIntersectFunctionNArguments { valid, geometryUserPtr, primID, context, rayhit, N, geomID }
        RTCOccludedFunctionNArguments { valid, geometryUserPtr, primID, context, ray, N, geomID }
        RTCFilterFunctionNArguments { valid, geometryUserPtr, context, ray, hit, N }
        RTCPointQuery { x, y, z, time, radius }
    };
    assert_eq!(c_layout(), rust);
}

/// The library writes 4 bytes at offset 80, so anything shorter is overrun on each hit.
#[test]
fn ray_hit_has_room_for_the_instance_primitive() {
    assert_eq!(size_of::<RTCRayHit>(), 96);
    assert_eq!(align_of::<RTCRayHit>(), 16);
    assert_eq!(std::mem::offset_of!(RTCRayHit, hit) + std::mem::offset_of!(RTCHit, instPrimID), 80);
}

#[test]
fn invalid_geometry_id_is_that_of_the_headers() {
    assert_eq!(RTC_INVALID_GEOMETRY_ID, embree4_sys_invalid_geometry_id());
}

#[test]
fn constructors_write_what_the_inline_functions_write() {
    let mut context = MaybeUninit::uninit();
    // SAFETY: the function writes every field.
    let context = unsafe {
        embree4_sys_init_context(context.as_mut_ptr());
        context.assume_init()
    };
    let ours = RTCRayQueryContext::new();
    assert_eq!((ours.instID, ours.instPrimID), (context.instID, context.instPrimID));

    let mut intersect = MaybeUninit::uninit();
    // SAFETY: the function writes every field.
    let intersect = unsafe {
        embree4_sys_init_intersect(intersect.as_mut_ptr());
        intersect.assume_init()
    };
    let ours = RTCIntersectArguments::new();
    assert_eq!(
        (ours.flags, ours.feature_mask, ours.context, ours.filter.is_some(), ours.intersect.is_some()),
        (
            intersect.flags,
            intersect.feature_mask,
            intersect.context,
            intersect.filter.is_some(),
            intersect.intersect.is_some()
        )
    );

    let mut occluded = MaybeUninit::uninit();
    // SAFETY: the function writes every field.
    let occluded = unsafe {
        embree4_sys_init_occluded(occluded.as_mut_ptr());
        occluded.assume_init()
    };
    let ours = RTCOccludedArguments::new();
    assert_eq!(
        (ours.flags, ours.feature_mask, ours.context, ours.filter.is_some(), ours.occluded.is_some()),
        (
            occluded.flags,
            occluded.feature_mask,
            occluded.context,
            occluded.filter.is_some(),
            occluded.occluded.is_some()
        )
    );
}
