"""What people run: commands, pictures, loops, processes. Hardly any arithmetic."""
