"""From characters to trees and formulas."""
