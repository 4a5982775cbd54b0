//! A process group for a tool that ends with it, and with this program however that ends, `kill -9` included.
//!
//! The leader of the group is a shell that reads a pipe which only this program holds the other end of. The tool joins the
//! group, and what it starts is in it too. When the pipe closes, since the tool is done or this program is gone, the shell
//! kills the whole group. (A parent-death signal, PR_SET_PDEATHSIG, would reach the tool itself and nothing that it started.)

use std::io::Result;
use std::os::unix::process::CommandExt;
use std::process::{Child, Command, Stdio};

/// A process group. Dropped, it ends all processes that are left in it.
pub(super) struct Guard(Child);

impl Guard {
    /// Starts the leader.
    pub(super) fn start() -> Result<Self> {
        let leader = Command::new("/bin/sh")
            .args(["-c", "read -r _; kill -KILL 0"])
            .process_group(0)
            .stdin(Stdio::piped())
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()?;
        Ok(Guard(leader))
    }

    /// Makes the command's process a member of the group.
    pub(super) fn join<'a>(&self, command: &'a mut Command) -> &'a mut Command {
        command.process_group(self.0.id() as i32)
    }
}

impl Drop for Guard {
    fn drop(&mut self) {
        drop(self.0.stdin.take());
        let _ = self.0.wait();
    }
}
