//! Serial ports on Linux: opened in raw mode at a baud rate and read for a limited time.

use std::{
    io::{self, Read},
    path::Path,
};

/// Returns true for a character device.
pub fn is_port(path: &Path) -> bool {
    #[cfg(unix)]
    {
        use std::os::unix::fs::FileTypeExt as _;
        std::fs::metadata(path).is_ok_and(|m| m.file_type().is_char_device())
    }
    #[cfg(not(unix))]
    {
        let _ = path;
        false
    }
}

/// An open port that reports its end after a time limit.
pub struct Port {
    #[cfg(target_os = "linux")]
    file: std::fs::File,
    #[cfg(target_os = "linux")]
    end: std::time::Instant,
}

#[cfg(not(target_os = "linux"))]
impl Port {
    /// Serial ports are not supported on this system.
    ///
    /// # Errors
    /// Always.
    pub fn open(_path: &Path, _baud: u32, _seconds: f64) -> io::Result<Self> {
        Err(io::Error::new(
            io::ErrorKind::Unsupported,
            "serial ports are opened on Linux only; set the port raw with stty, record it with cat, and read the file",
        ))
    }
}

#[cfg(not(target_os = "linux"))]
impl Read for Port {
    fn read(&mut self, _buffer: &mut [u8]) -> io::Result<usize> {
        Ok(0)
    }
}

#[cfg(target_os = "linux")]
impl Port {
    /// Opens a terminal device in raw mode (8 data bits, no parity, one stop bit, no flow control).
    ///
    /// # Errors
    /// A device that is not a terminal, an unsupported baud rate, or an error of the system.
    pub fn open(path: &Path, baud: u32, seconds: f64) -> io::Result<Self> {
        use std::os::{fd::AsRawFd as _, unix::fs::OpenOptionsExt as _};
        let speed = speed(baud).ok_or_else(|| {
            let problem = format!("no baud rate {baud}: 9600 to 3000000 in the usual steps");
            io::Error::new(io::ErrorKind::InvalidInput, problem)
        })?;
        // The port does not become the controlling terminal of this process, and opening does not wait for a carrier.
        let file = std::fs::OpenOptions::new()
            .read(true)
            .write(true)
            .custom_flags(libc::O_NOCTTY | libc::O_NONBLOCK)
            .open(path)?;
        let fd = file.as_raw_fd();
        // SAFETY: termios is plain data for which all zeros is a valid value; tcgetattr fills it.
        let mut settings: libc::termios = unsafe { std::mem::zeroed() };
        // SAFETY: `fd` is open and `settings` outlives the call.
        check(unsafe { libc::tcgetattr(fd, &mut settings) })?;
        // SAFETY: `settings` is an initialised termios.
        unsafe { libc::cfmakeraw(&mut settings) };
        settings.c_cflag |= libc::CLOCAL | libc::CREAD;
        settings.c_cflag &= !(libc::CRTSCTS | libc::CSTOPB | libc::PARENB);
        // A read returns the available bytes after a tenth of a second at the latest.
        settings.c_cc[libc::VMIN] = 0;
        settings.c_cc[libc::VTIME] = 1;
        // SAFETY: `settings` is an initialised termios and `speed` one of the system's constants.
        check(unsafe { libc::cfsetspeed(&mut settings, speed) })?;
        // SAFETY: `fd` is open and `settings` is initialised.
        check(unsafe { libc::tcsetattr(fd, libc::TCSANOW, &settings) })?;
        // SAFETY: `fd` is open; these two calls take and return flags only.
        let flags = check(unsafe { libc::fcntl(fd, libc::F_GETFL) })?;
        // SAFETY: as above.
        check(unsafe { libc::fcntl(fd, libc::F_SETFL, flags & !libc::O_NONBLOCK) })?;
        let time = std::time::Duration::from_secs_f64(seconds);
        Ok(Self {
            file,
            end: std::time::Instant::now() + time,
        })
    }
}

#[cfg(target_os = "linux")]
impl Read for Port {
    /// Waits for bytes. Returns 0 when the time is over.
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        while std::time::Instant::now() < self.end {
            match self.file.read(buffer) {
                Ok(0) => {}
                other => return other,
            }
        }
        Ok(0)
    }
}

#[cfg(target_os = "linux")]
fn check(result: libc::c_int) -> io::Result<libc::c_int> {
    if result < 0 {
        return Err(io::Error::last_os_error());
    }
    Ok(result)
}

#[cfg(target_os = "linux")]
fn speed(baud: u32) -> Option<libc::speed_t> {
    Some(match baud {
        9_600 => libc::B9600,
        19_200 => libc::B19200,
        38_400 => libc::B38400,
        57_600 => libc::B57600,
        115_200 => libc::B115200,
        230_400 => libc::B230400,
        460_800 => libc::B460800,
        921_600 => libc::B921600,
        1_000_000 => libc::B1000000,
        1_500_000 => libc::B1500000,
        2_000_000 => libc::B2000000,
        3_000_000 => libc::B3000000,
        _ => return None,
    })
}

#[cfg(all(test, target_os = "linux"))]
mod tests {
    use std::{
        ffi::CStr,
        fs::File,
        io::Write as _,
        os::fd::{AsRawFd as _, FromRawFd as _},
        path::PathBuf,
    };

    use super::*;

    /// Opens a pseudo-terminal: the side of the board, and the name of the port.
    fn pseudo_terminal() -> (File, PathBuf) {
        // SAFETY: the call takes flags and returns a new descriptor or -1.
        let fd = unsafe { libc::posix_openpt(libc::O_RDWR | libc::O_NOCTTY) };
        check(fd).unwrap();
        // SAFETY: `fd` was just opened and has no other owner.
        let board = unsafe { File::from_raw_fd(fd) };
        let mut name = [0; 128];
        // SAFETY: `fd` is an open pseudo-terminal; `name` has the stated length.
        unsafe {
            check(libc::grantpt(board.as_raw_fd())).unwrap();
            check(libc::unlockpt(board.as_raw_fd())).unwrap();
            check(libc::ptsname_r(
                board.as_raw_fd(),
                name.as_mut_ptr(),
                name.len(),
            ))
            .unwrap();
        }
        // SAFETY: ptsname_r terminated the name with a zero.
        let name = unsafe { CStr::from_ptr(name.as_ptr()) };
        (board, PathBuf::from(name.to_str().unwrap()))
    }

    #[test]
    fn every_byte_passes_a_raw_port_unchanged() {
        let (mut board, path) = pseudo_terminal();
        assert!(is_port(&path));
        let mut port = Port::open(&path, 921_600, 1.0).unwrap();
        // Control characters, line ends and 8-bit bytes: a terminal that is not in raw mode drops or changes them.
        let sent: Vec<u8> = (0..=255).rev().collect();
        board.write_all(&sent).unwrap();
        let mut found = Vec::new();
        let mut piece = [0; 64];
        while found.len() < sent.len() {
            let n = port.read(&mut piece).unwrap();
            assert!(n > 0, "the time is over after {} bytes", found.len());
            found.extend_from_slice(&piece[..n]);
        }
        assert_eq!(found, sent);
        assert_eq!(port.read(&mut piece).unwrap(), 0);
    }

    #[test]
    fn what_is_no_port_is_refused() {
        assert!(Port::open(Path::new("/dev/null"), 115_200, 0.1).is_err());
        let (_board, path) = pseudo_terminal();
        assert!(Port::open(&path, 12_345, 0.1).is_err());
        assert!(!is_port(Path::new("/")));
    }
}
