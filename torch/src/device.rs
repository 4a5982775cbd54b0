//! Devices by name.

use m4gn_base::{Error, Result};
use tch::Device;

/// `cpu`, `cuda` or `cuda:N`.
///
/// Errors: [`Error::Input`] for another name, or a device that this libtorch does not see.
pub fn parse_device(name: &str) -> Result<Device> {
    let device = match name.split_once(':') {
        None if name == "cpu" => Device::Cpu,
        None if name == "cuda" => Device::Cuda(0),
        Some(("cuda", n)) if n.parse::<usize>().is_ok() => Device::Cuda(n.parse().unwrap_or(0)),
        _ => {
            return Err(Error::Input(format!("device `{name}`: expected cpu, cuda or cuda:N")));
        }
    };
    if let Device::Cuda(n) = device {
        let found = if tch::Cuda::is_available() { tch::Cuda::device_count() } else { 0 };
        if n as i64 >= found {
            return Err(Error::Input(format!(
                "device `{name}`: this libtorch sees {found} CUDA devices; use --device cpu, or a libtorch with CUDA (LIBTORCH) on a machine with a GPU"
            )));
        }
    }
    Ok(device)
}
