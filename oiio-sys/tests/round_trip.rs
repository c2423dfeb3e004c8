//! What one function of the shim writes another reads back, through the OpenImageIO that is loaded.
#![allow(unsafe_code, reason = "calls C++")]

use std::ffi::{CStr, CString};
use std::fs::{File, OpenOptions};
use std::io;
use std::os::fd::AsRawFd;
use std::os::unix::ffi::OsStrExt;
use std::path::Path;
use std::ptr;

use oiio_sys::*;

fn shim() -> &'static Shim {
    oiio_sys::shim().expect("OpenImageIO loads")
}

const WIDTH: i32 = 3;
const HEIGHT: i32 = 2;

/// A description with channels of these names; to be freed.
fn spec(channels: &[&CStr], format: OiioFormat) -> *mut OiioSpec {
    // SAFETY: the new description is checked before use, and the names are NUL-terminated.
    unsafe {
        let spec = shim().oiio_spec_new(WIDTH, HEIGHT, channels.len() as i32, format);
        assert!(!spec.is_null());
        for (i, name) in channels.iter().enumerate() {
            assert!(shim().oiio_spec_set_channel_name(spec, i as i32, name.as_ptr()));
        }
        assert!(!shim().oiio_spec_set_channel_name(spec, channels.len() as i32, c"none".as_ptr()));
        spec
    }
}

fn write(file: &File, spec: *const OiioSpec, pixels: &[f32]) -> Result<(), (i32, String)> {
    let mut error = OiioError { system: 0, text: [0; 1024] };
    let channels = pixels.len() as i32 / (WIDTH * HEIGHT);
    let layer = OiioLayer { pixels: pixels.as_ptr().cast(), channels };
    // SAFETY: a live description, and a buffer of its size.
    let written = unsafe {
        let format = c"openexr".as_ptr();
        shim().oiio_write(
            file.as_raw_fd(),
            format,
            spec,
            &raw const layer,
            1,
            OIIO_FORMAT_FLOAT,
            &raw mut error,
        )
    };
    if written { Ok(()) } else { Err(reason(&error)) }
}

fn open(path: &Path, format: &CStr) -> Result<*mut OiioInput, (i32, String)> {
    let path = CString::new(path.as_os_str().as_bytes()).expect("no NUL in a path");
    let mut error = OiioError { system: 0, text: [0; 1024] };
    // SAFETY: both strings are NUL-terminated and the error is there to be written.
    let input = unsafe { shim().oiio_input_open(path.as_ptr(), format.as_ptr(), &raw mut error) };
    if input.is_null() { Err(reason(&error)) } else { Ok(input) }
}

fn reason(error: &OiioError) -> (i32, String) {
    // SAFETY: the shim terminates the text within the array.
    let text = unsafe { CStr::from_ptr(error.text.as_ptr()) };
    (error.system, text.to_string_lossy().into_owned())
}

/// Names of the channels of the current part, and its pixels.
fn read(input: *mut OiioInput) -> (Vec<String>, Vec<f32>) {
    let mut error = OiioError { system: 0, text: [0; 1024] };
    // SAFETY: the input is open; names are copied at once; the buffer has the length that is passed.
    unsafe {
        assert_eq!(
            (shim().oiio_input_width(input), shim().oiio_input_height(input), shim().oiio_input_depth(input)),
            (WIDTH, HEIGHT, 1)
        );
        let names: Vec<_> = (0..shim().oiio_input_channels(input))
            .map(|i| CStr::from_ptr(shim().oiio_input_channel_name(input, i)).to_string_lossy().into_owned())
            .collect();
        let mut pixels = vec![0.0; (WIDTH * HEIGHT) as usize * names.len()];
        assert!(
            shim().oiio_input_read(input, pixels.as_mut_ptr(), pixels.len(), &raw mut error),
            "{:?}",
            reason(&error)
        );
        assert!(!shim().oiio_input_read(input, pixels.as_mut_ptr(), pixels.len() - 1, &raw mut error));
        (names, pixels)
    }
}

/// The current part's attribute of that name: its number.
fn attribute(input: *const OiioInput, name: &CStr) -> Option<i32> {
    // SAFETY: the input is open, and the names are read at once.
    unsafe {
        (0..shim().oiio_input_attributes(input))
            .find(|&i| CStr::from_ptr(shim().oiio_input_attribute_name(input, i)) == name)
    }
}

#[test]
fn channels_and_attributes_of_each_kind() {
    let colour: Vec<f32> = (0..18).map(|i| i as f32 / 16.0).collect();
    let file = tempfile::NamedTempFile::new().expect("temporary file");
    let spec = spec(&[c"R", c"G", c"B"], OIIO_FORMAT_HALF);
    // SAFETY: the description is live and freed once, and all strings are NUL-terminated.
    unsafe {
        assert!(shim().oiio_spec_set_text(spec, c"cardioid:scene".as_ptr(), c"caf\xc3\xa9".as_ptr()));
        assert!(shim().oiio_spec_set_int(spec, c"cardioid:seed".as_ptr(), -7));
        assert!(shim().oiio_spec_set_float(spec, c"cardioid:radius".as_ptr(), 0.1));
        assert!(shim().oiio_spec_set_double(spec, c"cardioid:photons".as_ptr(), 4_294_967_297.0));
        write(file.as_file(), spec, &colour).expect("written");
        shim().oiio_spec_free(spec);
    }

    let input = open(file.path(), c"openexr").expect("opened");
    assert_eq!(read(input), (["R", "G", "B"].map(str::to_owned).to_vec(), colour));
    // SAFETY: the input is open until it is freed, and texts are read at once.
    unsafe {
        let scene = attribute(input, c"cardioid:scene").expect("text");
        assert_eq!(shim().oiio_input_attribute_kind(input, scene), OIIO_ATTRIBUTE_TEXT);
        assert_eq!(CStr::from_ptr(shim().oiio_input_attribute_text(input, scene)), c"caf\xc3\xa9");
        let seed = attribute(input, c"cardioid:seed").expect("int");
        assert_eq!(shim().oiio_input_attribute_kind(input, seed), OIIO_ATTRIBUTE_INT);
        assert_eq!(shim().oiio_input_attribute_int(input, seed), -7);
        let radius = attribute(input, c"cardioid:radius").expect("float");
        assert_eq!(shim().oiio_input_attribute_kind(input, radius), OIIO_ATTRIBUTE_DOUBLE);
        assert_eq!(shim().oiio_input_attribute_double(input, radius), f64::from(0.1_f32));
        let photons = attribute(input, c"cardioid:photons").expect("double");
        assert_eq!(shim().oiio_input_attribute_kind(input, photons), OIIO_ATTRIBUTE_DOUBLE);
        assert_eq!(shim().oiio_input_attribute_double(input, photons), 4_294_967_297.0);
        assert!(shim().oiio_input_attribute_text(input, -1).is_null());
        assert!(shim().oiio_input_attribute_name(input, i32::MAX).is_null());

        assert!(!shim().oiio_input_seek(input, 1));
        shim().oiio_input_free(input);
    }
}

#[test]
fn failures_are_told() {
    let (_, text) = open(Path::new("/nonexistent.exr"), c"openexr").expect_err("no such file");
    assert!(!text.is_empty());
    let (_, text) = open(Path::new("/nonexistent.exr"), c"no such format").expect_err("no such format");
    assert!(!text.is_empty());

    let file = tempfile::NamedTempFile::new().expect("temporary file");
    let read_only = OpenOptions::new().read(true).open(file.path()).expect("opened");
    let spec = spec(&[c"Y"], OIIO_FORMAT_FLOAT);
    let (system, _) = write(&read_only, spec, &[0.0; 6]).expect_err("not open for writing");
    assert_eq!(io::Error::from_raw_os_error(system).to_string(), "Bad file descriptor (os error 9)");
    // SAFETY: freed once, and freeing nothing is allowed.
    unsafe {
        shim().oiio_spec_free(spec);
        shim().oiio_spec_free(ptr::null_mut());
        shim().oiio_input_free(ptr::null_mut());
    }
}

#[test]
fn version_is_one_that_the_shim_knows() {
    // SAFETY: takes nothing.
    assert!(unsafe { shim().oiio_version() } >= 2_04_00);
}
