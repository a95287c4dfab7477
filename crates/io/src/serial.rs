//! Serial ports on Linux: opened in raw mode at a baud rate and read for a limited time.

use std::{
    io::{self, Read},
    path::Path,
    time::{Duration, Instant},
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

/// A terminal device in raw mode whose reads and writes never wait; [`Terminal::wait`] waits.
pub struct Terminal {
    #[cfg(target_os = "linux")]
    file: std::fs::File,
}

#[cfg(not(target_os = "linux"))]
impl Terminal {
    /// Serial ports are not supported on this system.
    ///
    /// # Errors
    /// Always.
    pub fn open(_path: &Path, _baud: u32) -> io::Result<Self> {
        Err(io::Error::new(
            io::ErrorKind::Unsupported,
            "serial ports are opened on Linux only; set the port raw with stty, record it with cat, and read the file",
        ))
    }

    /// Never called, because no terminal can be opened.
    ///
    /// # Errors
    /// Always.
    pub fn wait(&self, _timeout: Duration) -> io::Result<bool> {
        Err(io::ErrorKind::Unsupported.into())
    }

    /// Never called, because no terminal can be opened.
    ///
    /// # Errors
    /// Always.
    pub fn set_baud(&self, _baud: u32) -> io::Result<()> {
        Err(io::ErrorKind::Unsupported.into())
    }

    /// Never called, because no terminal can be opened.
    ///
    /// # Errors
    /// Always.
    pub fn discard_input(&self) -> io::Result<()> {
        Err(io::ErrorKind::Unsupported.into())
    }

    /// Never called, because no terminal can be opened.
    ///
    /// # Errors
    /// Always.
    pub fn write_until(&mut self, _bytes: &[u8], _deadline: Instant) -> io::Result<()> {
        Err(io::ErrorKind::Unsupported.into())
    }
}

#[cfg(not(target_os = "linux"))]
impl Read for Terminal {
    fn read(&mut self, _buffer: &mut [u8]) -> io::Result<usize> {
        Ok(0)
    }
}

#[cfg(target_os = "linux")]
impl Terminal {
    /// Opens a terminal device in raw mode (8 data bits, no parity, one stop bit, no flow control).
    ///
    /// # Errors
    /// A device that is not a terminal, an unsupported baud rate, or an error of the system.
    pub fn open(path: &Path, baud: u32) -> io::Result<Self> {
        use std::os::{fd::AsRawFd as _, unix::fs::OpenOptionsExt as _};
        if !is_supported(baud) {
            return Err(unsupported(baud));
        }
        // The port does not become the controlling terminal of this process, and nothing waits for a carrier.
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
        // With a minimum of one byte, a read of 0 bytes means that the device is gone, and never that it is silent.
        settings.c_cc[libc::VMIN] = 1;
        settings.c_cc[libc::VTIME] = 0;
        // SAFETY: `fd` is open and `settings` is initialised.
        check(unsafe { libc::tcsetattr(fd, libc::TCSANOW, &settings) })?;
        let terminal = Self { file };
        terminal.set_baud(baud)?;
        Ok(terminal)
    }

    /// Waits at most `timeout` for bytes. Returns true if there is something to read: bytes, an end or an error. False
    /// means silence.
    ///
    /// # Errors
    /// An error of the system, [`io::ErrorKind::Interrupted`] among them.
    pub fn wait(&self, timeout: Duration) -> io::Result<bool> {
        self.poll(libc::POLLIN, timeout)
    }

    fn poll(&self, events: libc::c_short, timeout: Duration) -> io::Result<bool> {
        use std::os::fd::AsRawFd as _;
        let mut request = libc::pollfd {
            fd: self.file.as_raw_fd(),
            events,
            revents: 0,
        };
        // Rounded up, so that a caller with a deadline does not spin during the last millisecond.
        let millis = timeout.as_nanos().div_ceil(1_000_000);
        let millis = libc::c_int::try_from(millis).unwrap_or(libc::c_int::MAX);
        // SAFETY: `request` is one initialised pollfd and outlives the call.
        Ok(check(unsafe { libc::poll(&raw mut request, 1, millis) })? > 0)
    }

    /// Changes the baud rate of the device, also for others that have it open.
    ///
    /// # Errors
    /// An unsupported baud rate, or an error of the system.
    pub fn set_baud(&self, baud: u32) -> io::Result<()> {
        use std::os::fd::AsRawFd as _;
        let fd = self.file.as_raw_fd();
        if let Some(speed) = speed(baud) {
            // SAFETY: termios is plain data for which all zeros is a valid value; tcgetattr fills it.
            let mut settings: libc::termios = unsafe { std::mem::zeroed() };
            // SAFETY: `fd` is open and `settings` outlives the call.
            check(unsafe { libc::tcgetattr(fd, &mut settings) })?;
            settings.c_cflag &= !INPUT_SPEED;
            // SAFETY: `settings` is an initialised termios and `speed` one of the system's constants.
            check(unsafe { libc::cfsetspeed(&mut settings, speed) })?;
            // SAFETY: `fd` is open and `settings` is initialised.
            check(unsafe { libc::tcsetattr(fd, libc::TCSANOW, &settings) })?;
            return Ok(());
        }
        if !RATES_WITHOUT_NAME.contains(&baud) {
            return Err(unsupported(baud));
        }
        // SAFETY: termios2 is plain data for which all zeros is a valid value; the call fills it.
        let mut settings: libc::termios2 = unsafe { std::mem::zeroed() };
        // SAFETY: `fd` is open and `settings` outlives the call.
        check(unsafe { libc::ioctl(fd, libc::TCGETS2, &raw mut settings) })?;
        settings.c_cflag &= !(libc::CBAUD | INPUT_SPEED);
        settings.c_cflag |= libc::BOTHER;
        settings.c_ispeed = baud;
        settings.c_ospeed = baud;
        // SAFETY: `fd` is open and `settings` is initialised.
        check(unsafe { libc::ioctl(fd, libc::TCSETS2, &raw const settings) })?;
        Ok(())
    }

    /// Discards the bytes that were received and not yet read.
    ///
    /// # Errors
    /// An error of the system.
    pub fn discard_input(&self) -> io::Result<()> {
        use std::os::fd::AsRawFd as _;
        // SAFETY: the descriptor is open; the call takes a constant only.
        check(unsafe { libc::tcflush(self.file.as_raw_fd(), libc::TCIFLUSH) })?;
        Ok(())
    }

    /// Writes all bytes before `deadline`.
    ///
    /// # Errors
    /// [`io::ErrorKind::TimedOut`] after the deadline, or an error of the system.
    pub fn write_until(&mut self, mut bytes: &[u8], deadline: Instant) -> io::Result<()> {
        use std::io::Write as _;
        while !bytes.is_empty() {
            match self.file.write(bytes) {
                Ok(n) => bytes = &bytes[n..],
                Err(e) if e.kind() == io::ErrorKind::Interrupted => {}
                Err(e) if e.kind() == io::ErrorKind::WouldBlock => {
                    let left = deadline.saturating_duration_since(Instant::now());
                    if left.is_zero() {
                        return Err(io::ErrorKind::TimedOut.into());
                    }
                    match self.poll(libc::POLLOUT, left) {
                        Err(e) if e.kind() != io::ErrorKind::Interrupted => return Err(e),
                        _ => {}
                    }
                }
                Err(e) => return Err(e),
            }
        }
        Ok(())
    }
}

#[cfg(target_os = "linux")]
impl Read for Terminal {
    /// Reads the bytes that are there; [`io::ErrorKind::WouldBlock`] if there are none, 0 if the device is gone.
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        self.file.read(buffer)
    }
}

/// An open port that reports its end after a time limit, or when the device is gone.
pub struct Port {
    terminal: Terminal,
    end: Instant,
}

impl Port {
    /// Opens a terminal device in raw mode.
    ///
    /// # Errors
    /// Those of [`Terminal::open`].
    pub fn open(path: &Path, baud: u32, seconds: f64) -> io::Result<Self> {
        Ok(Self {
            terminal: Terminal::open(path, baud)?,
            end: Instant::now() + Duration::from_secs_f64(seconds),
        })
    }
}

impl Read for Port {
    /// Waits for bytes. Returns 0 when the time is over.
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        loop {
            let left = self.end.saturating_duration_since(Instant::now());
            if left.is_zero() {
                return Ok(0);
            }
            if !self.terminal.wait(left)? {
                continue;
            }
            match self.terminal.read(buffer) {
                Err(e) if e.kind() == io::ErrorKind::WouldBlock => {}
                other => return other,
            }
        }
    }
}

#[cfg(target_os = "linux")]
fn check(result: libc::c_int) -> io::Result<libc::c_int> {
    if result < 0 {
        return Err(io::Error::last_os_error());
    }
    Ok(result)
}

/// Baud rates of TI's boards for which the system has no constant.
#[cfg(target_os = "linux")]
const RATES_WITHOUT_NAME: [u32; 3] = [625_000, 1_250_000, 3_125_000];

/// The flags of another speed for received bytes than for sent ones. All zeros mean the same speed.
#[cfg(target_os = "linux")]
const INPUT_SPEED: libc::tcflag_t = libc::CBAUD << 16;

#[cfg(target_os = "linux")]
fn is_supported(baud: u32) -> bool {
    speed(baud).is_some() || RATES_WITHOUT_NAME.contains(&baud)
}

#[cfg(target_os = "linux")]
fn unsupported(baud: u32) -> io::Error {
    let problem = format!("no baud rate {baud}: 9600 to 3125000 in the usual steps");
    io::Error::new(io::ErrorKind::InvalidInput, problem)
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

#[cfg(test)]
#[cfg(target_os = "linux")]
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
    fn a_port_is_set_to_rates_with_and_without_a_name() {
        let (_board, path) = pseudo_terminal();
        let port = Terminal::open(&path, 115_200).unwrap();
        let rates = || {
            // SAFETY: termios2 is plain data for which all zeros is a valid value; the call fills it.
            let mut settings: libc::termios2 = unsafe { std::mem::zeroed() };
            // SAFETY: the descriptor is open and `settings` outlives the call.
            let result =
                unsafe { libc::ioctl(port.file.as_raw_fd(), libc::TCGETS2, &raw mut settings) };
            check(result).unwrap();
            (settings.c_ispeed, settings.c_ospeed)
        };
        assert_eq!(rates(), (115_200, 115_200));
        for baud in [1_250_000, 115_200, 3_125_000, 921_600, 625_000] {
            port.set_baud(baud).unwrap();
            assert_eq!(rates(), (baud, baud));
        }
        for baud in [0, 12_345, 1_250_001, u32::MAX] {
            assert!(port.set_baud(baud).is_err(), "{baud}");
        }
        assert_eq!(rates(), (625_000, 625_000));
        drop(Terminal::open(&path, 1_250_000).unwrap());
        assert_eq!(rates(), (1_250_000, 1_250_000));
    }

    #[test]
    fn what_is_no_port_is_refused() {
        assert!(Port::open(Path::new("/dev/null"), 115_200, 0.1).is_err());
        let (_board, path) = pseudo_terminal();
        assert!(Port::open(&path, 12_345, 0.1).is_err());
        assert!(!is_port(Path::new("/")));
    }
}
